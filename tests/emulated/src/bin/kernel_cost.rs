//! Instructions per impact of the board's kernel, one line per workload: `instructions KERNEL
//! WORKLOAD COUNT`. Run it with an emulator clock that counts instructions.
#![cfg_attr(target_os = "none", no_std, no_main)]

kband_emulated::image!(run);

#[cfg(not(target_os = "none"))]
fn run() {
    kband_emulated::emit!("nothing counts instructions at the desk");
}

#[cfg(target_os = "none")]
fn run() {
    use cost::measure;
    use kband::impact::{Kernel, Single, Tone, WaveKernel};
    use kband_emulated::kernels::{CHATTER, ORBITS, WAVE_CHATTER, WAVES, begin, begin_on_tones};

    let counter = kband_emulated::Counter::start();
    let track = |k| Single::build(k, 0.8).expect("a k within range");
    let one = measure(&counter, "f32", (ORBITS, CHATTER), begin, track);
    // Bounds: the counted value, plus 3 % for another compiler.
    assert!(one.orbits <= 195, "{}", one.orbits);
    assert!(one.set_up <= 680, "{}", one.set_up);
    assert!(one.worst <= 237, "{}", one.worst);
    let waves = (WAVES, WAVE_CHATTER);
    let tones = [Tone::new(0.15, 2.356), Tone::default()];
    let track = |k| Single::on_tones(tones, k, 0.8).expect("a k within range");
    let two = measure(&counter, "f32-tones", waves, begin_on_tones, track);
    // A second tone may double the cost.
    let costs = [two.orbits, two.high, two.low].into_iter();
    for (two, one) in costs.zip([one.orbits, one.high, one.low]) {
        assert!(100 * two <= 206 * one, "{two} for {one}");
    }
}

#[cfg(target_os = "none")]
mod cost {
    use core::hint::black_box;

    use kband::arithmetic::Noise;
    use kband::impact::{Kernel, Single, SingleState};
    use kband_emulated::kernels::{Machine, next};
    use kband_emulated::{Counter, emit};

    type Start = (Single, SingleState);

    /// k of eight tracks.
    const TRACKS: [f64; 8] = [0.06, 0.12, 0.2, 0.3, 0.42, 0.55, 0.7, 0.85];

    pub struct Cost {
        /// The most expensive orbit that stays locked or chaotic.
        pub worst: u64,
        pub orbits: u64,
        pub set_up: u64,
        pub high: u64,
        pub low: u64,
    }

    /// Counts the instructions of each workload: orbits, one that chatters, and tracks.
    #[inline(never)]
    pub fn measure<const N: usize, const V: usize>(
        counter: &Counter,
        name: &str,
        (orbits, chatter): ([[f64; V]; N], [f64; V]),
        begin: fn([f64; V]) -> Start,
        track: impl Fn(f64) -> Single + Copy,
    ) -> Cost {
        let costs = orbits.map(|values| {
            let cost = orbit(counter, begin(values));
            let (k, restitution) = (values[0], values[1]);
            emit!("instructions {name} orbit-{k}-{restitution} {cost}");
            cost
        });
        let orbits = costs.iter().sum::<u64>() / N as u64;
        let chatter = orbit(counter, begin(chatter));
        let set_up = counter.count(|| {
            for k in TRACKS {
                black_box(track(black_box(k)));
            }
        }) / TRACKS.len() as u64;
        let kernels = TRACKS.map(track);
        // Mean cost of one impact from each state.
        let falls = |top| {
            let states = states(top);
            counter.count(|| {
                black_box(fall(&kernels, &states));
            }) / states.len() as u64
        };
        let (high, low) = (falls(20.0), falls(3.0));
        emit!("instructions {name} orbits {orbits}, chatter {chatter}, set-up {set_up}");
        emit!("instructions {name} high {high}, low {low}");
        Cost {
            worst: costs.into_iter().max().unwrap_or(0),
            orbits,
            set_up,
            high,
            low,
        }
    }

    /// 256 states on [`TRACKS`], with velocities up to `top`.
    fn states(top: f64) -> [(SingleState, u8); 256] {
        let mut noise = Noise::new(1);
        core::array::from_fn(|i| {
            let phase = f64::from(noise.uniform()) * core::f64::consts::TAU;
            let velocity = f64::from(noise.uniform()) * top;
            let state = Single::state(phase, velocity).expect("a state within range");
            (state, (i & 7) as u8)
        })
    }

    /// Computes one impact from each state, and combines their bits, so the compiler can skip none.
    #[inline(never)]
    fn fall(kernels: &[Single; 8], states: &[(SingleState, u8)]) -> u32 {
        let mut sum = 0_u32;
        for &(state, index) in states {
            let landing = kernels[usize::from(index & 7)].land(state);
            let [phase, velocity] = Single::bits(landing.next);
            sum = sum.wrapping_add(phase ^ velocity);
        }
        sum
    }

    /// State after `count` impacts.
    #[inline(never)]
    fn fly(kernel: &Single, start: SingleState, count: u32) -> SingleState {
        (0..count).fold(start, |state, _| next(kernel, start, state))
    }

    fn orbit(counter: &Counter, (kernel, start): Start) -> u64 {
        let count = 500;
        // The first impacts are the transient.
        let settled = fly(&kernel, start, 100);
        counter.count(|| {
            black_box(fly(&kernel, settled, count));
        }) / u64::from(count)
    }
}
