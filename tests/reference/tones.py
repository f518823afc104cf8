#!/usr/bin/env python3
"""Golden impacts on tracks of two and three tones: writes tones.csv.

    python3 -m pip install mpmath==1.3.0
    python3 tests/reference/tones.py            # about two minutes

The track moves as S(t) = sin t + e sin(2 t + th) + e3 sin(3 t + th3). A part launched at phase t
with velocity psi is u(d) = (S'(t) + psi) d - k d^2/2 - (S(t + d) - S(t)) above it. The flight is
the first d > 0 with u(d) = 0. Inputs are exact doubles. The script computes with 50 digits and
prints 25.

It shares nothing with the kernels that it judges. The candidate comes from convexity: u'' = A - k
with A = -S'' changes sign only at roots of a polynomial in exp(i t), and all of these are found.
Between two of them u is convex or concave.

A march without convexity then proves that the candidate is the first root. The fourth derivative
of u is at most 1 + 16 e + 81 e3, so a polynomial in h is a lower bound of u(d + h). No step is
longer than that bound stays positive. A case without proof is not written.
"""

import csv
import pathlib
import random

from mpmath import mp, mpf, mpc

mp.dps = 50


class Track:
    """A track of one to three tones, k included."""

    def __init__(self, k, e, th, e3, th3):
        self.row = (k, e, th, e3, th3)
        self.k = mpf(k)
        self.tones = [(1, mpf(1), mpf(0)), (2, mpf(e), mpf(th)), (3, mpf(e3), mpf(th3))]
        self.tones = [tone for tone in self.tones if tone[1] != 0]
        self.fourth = sum(q**4 * a for q, a, _ in self.tones)
        self.edges = self._edges()

    def at(self, t):
        """S, S', A = -S'', A' and A'' at phase t."""
        s = c = a = j = w = mpf(0)
        for q, amplitude, angle in self.tones:
            x, y = mp.sin(q * t + angle), mp.cos(q * t + angle)
            s += amplitude * x
            c += amplitude * q * y
            a += amplitude * q**2 * x
            j += amplitude * q**3 * y
            w -= amplitude * q**4 * x
        return s, c, a, j, w

    def _edges(self):
        """Phases in 0..2 pi where A = k, in order: unit roots of a polynomial in exp(i t)."""
        n = max(q for q, _, _ in self.tones)
        coefficients = [mpc(0)] * (2 * n + 1)
        coefficients[n] = mpc(-self.k)
        for q, amplitude, angle in self.tones:
            half = amplitude * q**2 / mpc(0, 2)
            coefficients[n - q] += half * mp.expj(angle)
            coefficients[n + q] -= half * mp.expj(-angle)
        roots = mp.polyroots(coefficients, maxsteps=1000, extraprec=400)
        edges = []
        for z in roots:
            if abs(abs(z) - 1) < mpf(10) ** -20:
                t = mp.arg(z) % (2 * mp.pi)
                for _ in range(6):
                    _, _, a, j, _ = self.at(t)
                    if j != 0:
                        t -= (a - self.k) / j
                edges.append(t % (2 * mp.pi))
        return sorted(edges)


class Flight:
    """A launch and the gap that follows it."""

    def __init__(self, track, phase, velocity):
        self.track = track
        self.phase = mpf(phase)
        self.velocity = mpf(velocity)
        self.s, self.c, self.a, self.j, _ = track.at(self.phase)

    def gap(self, d):
        """u and its first three derivatives."""
        s, c, a, j, _ = self.track.at(self.phase + d)
        k = self.track.k
        v = self.c + self.velocity
        return v * d - k * d * d / 2 - (s - self.s), v - k * d - c, a - k, j

    def start(self):
        """A time up to which the Taylor series of u/d proves u > 0; 0 if none."""
        w0, w1, w2 = self.velocity, (self.a - self.track.k) / 2, self.j / 6
        w3 = self.track.fourth / 24
        h = mpf(1)
        for _ in range(400):
            if w0 > 0:
                clear = w0 + min(w1, 0) * h + min(w2, 0) * h**2 - w3 * h**3 > 0
            elif w1 > 0:
                clear = w1 + min(w2, 0) * h - w3 * h**2 > 0
            else:
                clear = w2 - w3 * h > 0
            if clear:
                return h
            h /= 2
        return mpf(0)

    def candidate(self):
        """The first impact by convexity."""
        turn = 2 * mp.pi
        edges = sorted((edge - self.phase) % turn for edge in self.track.edges)
        low = self.start()
        if low == 0:
            return None
        highest = sum(a for _, a, _ in self.track.tones)
        for n in range(4000):
            ends = [edge + n * turn for edge in edges] if edges else [(n + 1) * turn]
            for end in ends:
                if end <= low:
                    continue
                u, slope, _, _ = self.gap(end)
                if u <= 0:
                    return self._root(low, end)
                u_low, slope_low, _, _ = self.gap(low)
                middle = (low + end) / 2
                if self.gap(middle)[2] > 0 and slope_low < 0 < slope:
                    lowest = self._turning(low, end)
                    if self.gap(lowest)[0] <= 0:
                        return self._root(low, lowest)
                low = end
            if (self.c + self.velocity) * low - self.track.k * low**2 / 2 + self.s < -highest:
                raise ValueError("the ball fell through the track")
        return None

    def _turning(self, low, high):
        for _ in range(200):
            middle = (low + high) / 2
            if self.gap(middle)[1] > 0:
                high = middle
            else:
                low = middle
        return (low + high) / 2

    def _root(self, low, high):
        """The one down-crossing in low..high."""
        for _ in range(40):
            middle = (low + high) / 2
            if self.gap(middle)[0] > 0:
                low = middle
            else:
                high = middle
        d = (low + high) / 2
        for _ in range(200):
            u, slope, _, _ = self.gap(d)
            if u > 0:
                low = d
            else:
                high = d
            step = -u / slope if slope != 0 else mpf(0)
            following = d + step
            if not low < following < high:
                following = (low + high) / 2
            if abs(following - d) <= mpf(10) ** -46 * d:
                break
            d = following
        return d

    def proves(self, d):
        """Whether there is no impact before d, except a touch within 1e-26 of it, relative."""
        x = self.start()
        if x == 0:
            return False
        fourth = self.track.fourth / 24
        for _ in range(5000):
            rest = d - x
            if rest <= d * mpf(10) ** -26:
                return True
            u, slope, bend, third = self.gap(x)
            if u <= 0:
                return False
            if (
                slope < 0
                and slope + max(bend, 0) * rest + max(third, 0) * rest**2 / 2 + 4 * fourth * rest**3
                < 0
            ):
                # u falls in the whole interval.
                return self.gap(d)[1] <= 0
            h = min(mpf(2), rest)
            while True:
                least = (
                    u
                    + min(slope, 0) * h
                    + min(bend, 0) * h**2 / 2
                    + min(third, 0) * h**3 / 6
                    - fourth * h**4
                )
                if least > 0:
                    break
                h /= 2
                if h < d * mpf(10) ** -27:
                    return False
            x += h
        return False


def shape(rng):
    """Second and third tone."""
    e = rng.choice([0.0, 0.05, 0.1, 0.15, 0.15, 0.2, 0.25, 0.35, 0.5, rng.uniform(0, 0.5)])
    th = rng.choice([2.2, 2.356, 2.487, 2.6, rng.uniform(0, 6.283), rng.uniform(2.1, 2.9)])
    e3, th3 = 0.0, 0.0
    if rng.random() < 0.35:
        e3 = rng.choice([0.03, 0.07, 0.15, rng.uniform(0, 0.3), 0.5])
        th3 = rng.uniform(0, 6.283)
    return e, th, e3, th3


def below_turn(t):
    t = float(t)
    return t if 0.0 <= t < 6.283185307179586 else None


def launch(kind, rng):
    """A random launch of a kind: track, phase, velocity; None without a solution."""
    k = rng.choice([rng.uniform(0.02, 0.98), rng.uniform(0.25, 0.65), rng.uniform(0.02, 2.0)])
    track = Track(k, *shape(rng))
    phase, velocity = rng.uniform(0, 6.283), rng.uniform(0.02, 3)
    if kind == "high":
        velocity = rng.uniform(3, 20)
    elif kind == "short":
        velocity = 10 ** rng.uniform(-14, -2)
        if track.at(mpf(phase))[2] >= k:
            return None
    elif kind in ("liftoff", "grazing"):
        throwing = [t for t in track.edges if track.at(t)[3] > 0]
        if not throwing:
            return None
        entry = rng.choice(throwing)
        leaving = [t for t in track.edges if track.at(t)[3] < 0]
        width = min((t - entry) % (2 * mp.pi) for t in leaving)
        if kind == "liftoff":
            # From rest just after the track begins to throw; one in two later in the window.
            late = rng.choice([10 ** rng.uniform(-9, -2), rng.uniform(0, 1)])
            phase = below_turn((entry + width * mpf(late)) % (2 * mp.pi))
            velocity = 0.0
            if phase is None or track.at(mpf(phase))[2] <= k:
                return None
        else:
            # Back along the parabola that touches the track in this window, to its launch.
            touch = entry + width * mpf(rng.uniform(0.02, 0.98))
            s, c, _, _, _ = track.at(touch)
            past, found = mpf(rng.uniform(0.05, 9)), None
            before = None
            while past < 40:
                gap = s - c * past - mpf(k) * past**2 / 2 - track.at(touch - past)[0]
                if before is not None and before > 0 >= gap:
                    found = (past - mpf("0.1"), past)
                    break
                before, past = gap, past + mpf("0.1")
            if found is None:
                return None
            near, far = found
            for _ in range(60):
                middle = (near + far) / 2
                gap = s - c * middle - mpf(k) * middle**2 / 2 - track.at(touch - middle)[0]
                near, far = (middle, far) if gap > 0 else (near, middle)
            phase = below_turn((touch - far) % (2 * mp.pi))
            if phase is None:
                return None
            start = track.at(mpf(phase))[1]
            aside = rng.choice([-1, 1]) * 10 ** rng.uniform(-13, -2)
            velocity = float(c + mpf(k) * far - start + aside)
            if not 0 < velocity < 20:
                return None
    return track, phase, velocity


def write(out, kind, track, restitution, phase, velocity):
    """Writes one impact if it is proven; its state after, or None."""
    flight = Flight(track, phase, velocity)
    d = flight.candidate()
    if d is None or not flight.proves(d):
        return None
    slope = flight.gap(d)[1]
    if slope >= 0:
        return None
    following = (flight.phase + d) % (2 * mp.pi)
    velocity_after = -mpf(restitution) * slope
    numbers = [mp.nstr(x, 25, strip_zeros=False) for x in (d, following, velocity_after)]
    k, e, th, e3, th3 = track.row
    out.writerow(
        [
            kind,
            repr(k),
            repr(restitution),
            repr(e),
            repr(th),
            repr(e3),
            repr(th3),
            repr(phase),
            repr(velocity),
            *numbers,
            mp.nstr(d / -slope, 6),
        ]
    )
    return below_turn(following), float(velocity_after)


def main():
    rng = random.Random(19890716)
    path = pathlib.Path(__file__).with_name("tones.csv")
    with path.open("w", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(
            "class k restitution e th e3 th3 phase velocity "
            "flight next_phase next_velocity condition".split()
        )
        for kind, count in (
            ("typical", 400),
            ("high", 150),
            ("short", 150),
            ("liftoff", 200),
            ("grazing", 250),
        ):
            written = tried = 0
            while written < count:
                tried += 1
                drawn = launch(kind, rng)
                if drawn and write(out, kind, drawn[0], rng.uniform(0, 0.95), *drawn[1:]):
                    written += 1
            print(f"{kind}: {written} of {tried} drawn")
        # Hop by hop to the end of the chatter, each from the reference state rounded to a double.
        written = 0
        while written < 250:
            drawn = launch("typical", rng)
            track, phase, velocity = drawn[0], drawn[1], min(drawn[2], 0.5)
            restitution = rng.uniform(0.1, 0.7)
            for _ in range(25):
                state = write(out, "chatter", track, restitution, phase, velocity)
                if state is None or state[0] is None or state[1] < 1e-12:
                    break
                phase, velocity = state
                written += 1
        print(f"chatter: {written}")


if __name__ == "__main__":
    main()
