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
    use kband_emulated::kernels::{
        CHATTER, ORBITS, WAVE_CHATTER, WAVES, begin, begin_on_tones, track, track_on_tones,
    };

    let counter = kband_emulated::Counter::start();
    let one = measure(&counter, "f32", (ORBITS, CHATTER), begin, track);
    // Bounds: the counted value, plus 3 % for another compiler.
    assert!(one.orbits <= 195, "{}", one.orbits);
    assert!(one.set_up <= 680, "{}", one.set_up);
    assert!(one.worst <= 237, "{}", one.worst);
    let waves = (WAVES, WAVE_CHATTER);
    let two = measure(&counter, "f32-tones", waves, begin_on_tones, track_on_tones);
    // A second tone may double the cost.
    let costs = [two.orbits, two.high, two.low].into_iter();
    for (two, one) in costs.zip([one.orbits, one.high, one.low]) {
        assert!(100 * two <= 206 * one, "{two} for {one}");
    }
}

#[cfg(target_os = "none")]
mod cost {
    use core::hint::black_box;

    use kband::impact::{Single, SingleState};
    use kband_emulated::kernels::{TRACKS, fall, fly, states};
    use kband_emulated::{Counter, emit};

    type Start = (Single, SingleState);

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
            let states = states::<Single>(top);
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

    fn orbit(counter: &Counter, (kernel, start): Start) -> u64 {
        let count = 500;
        // The first impacts are the transient.
        let settled = fly(&kernel, start, 100);
        counter.count(|| {
            black_box(fly(&kernel, settled, count));
        }) / u64::from(count)
    }
}
