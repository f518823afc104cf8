// A scan in steps of 0.05 rad and Boost's TOMS 748 on the launches of `kband bench`: ns an impact as CSV. Run by compare.sh beside it.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <vector>

#include <boost/math/tools/toms748_solve.hpp>

struct Launch {
    double k, phase, velocity;
};

// The launches of host/src/bench/workload.rs: SplitMix64 from 1.
static std::vector<Launch> launches(double top, int count) {
    std::uint64_t state = 1;
    auto part = [&] {
        state += 0x9e3779b97f4a7c15u;
        std::uint64_t z = state;
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
        return double((z ^ (z >> 31)) >> 11) / double(std::uint64_t(1) << 53);
    };
    std::vector<Launch> all;
    while (int(all.size()) < count) {
        part();
        double k = 0.02 + 0.96 * part();
        double phase = 2 * M_PI * part();
        all.push_back({k, phase, top * part()});
    }
    return all;
}

static double flight(const Launch &launch) {
    const double s = std::sin(launch.phase), v = launch.velocity + std::cos(launch.phase);
    auto gap = [&](double d) { return s + d * (v - 0.5 * launch.k * d) - std::sin(launch.phase + d); };
    // Above height 1 there is no track: the scan goes on where the part has fallen to it again.
    const double square = v * v - 2 * launch.k * (1 - s);
    const double rise = square > 0 && v > 0 ? (v - std::sqrt(square)) / launch.k : 0;
    const double fall = square > 0 && v > 0 ? (v + std::sqrt(square)) / launch.k : 0;
    double low = 1e-3;
    while (gap(low) <= 0 && low > 1e-9) low *= 0.1;
    double high = low;
    do {
        low = high;
        high += 0.05;
        if (high > rise && high < fall) {
            low = rise;
            high = fall;
        }
    } while (gap(high) > 0);
    std::uintmax_t rounds = 100;
    auto found = boost::math::tools::toms748_solve(
        gap, low, high, boost::math::tools::eps_tolerance<double>(52), rounds);
    return 0.5 * (found.first + found.second);
}

int main() {
    const int count = 16384, turn = 1024;
    for (auto [name, top] : {std::pair{"high", 20.0}, std::pair{"low", 3.0}}) {
        auto all = launches(top, count);
        std::vector<double> times;
        double sum = 0;
        for (int at = 0; at + turn <= count; at += turn) {
            auto begun = std::chrono::steady_clock::now();
            for (int n = at; n < at + turn; ++n) sum += flight(all[n]);
            std::chrono::duration<double, std::nano> spent = std::chrono::steady_clock::now() - begun;
            times.push_back(spent.count() / turn);
        }
        std::sort(times.begin(), times.end());
        // Printed, so that no flight is left out.
        std::fprintf(stderr, "sum of flights %.3f\n", sum);
        std::printf("C++ scan and TOMS 748,%s,%.1f\n", name, times[times.size() / 2]);
    }
}
