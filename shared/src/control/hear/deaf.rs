//! Whether the board hears at all: parts that the track throws must strike it, and how loud is known.

// At a fifth to a half and at twice to four times of each of these, a test below fails; SILENT alone may be less.

/// Least height of the ringing of an impact over its speed, in 1/s: a third of what the accelerometer of a bare track rings with.
const RINGING: f32 = 10.0;
/// That of a bare track.
const BARE: f32 = 30.0;
/// Loudness over the threshold of the onset detector from which on an impact must be heard.
const CLEARLY: f32 = 2.0;
/// Threshold of the onset detector over the noise in the residual.
const THRESHOLD: f32 = 6.0;
/// Impacts heard over the impacts due, below which nothing counts as heard, and above which the parts are.
const SILENT: f32 = 0.25;
const HEARD: f32 = 0.5;
/// Concentration of their phases from which on they are no noise: that of two at random over the turn is as high in a third
/// of all cases, of the sixteen in memory in one of 300.
const REGULAR: f32 = 0.6;
/// Cycles of such silence: twice the memory of the impacts' rate, and less than the patience before a kick.
const PATIENCE: u8 = 32;
/// Cycles in a row in which the parts are heard, after which it hears again: the memory of the impacts' rate.
const AGAIN: u8 = 16;

/// What a cycle shows of what is heard.
#[derive(Clone, Copy, Debug)]
pub struct Sound {
    /// Whether the drive holds a setpoint and what is heard decides something.
    pub listening: bool,
    /// Whether all parts are to be in one lock.
    pub together: bool,
    /// Whether the amplitude is there.
    pub near: bool,
    /// Impacts heard over the impacts due, of one part.
    pub rate: f32,
    /// Concentration of the impacts' phases, 0..1.
    pub concentration: f32,
    /// Speeds in m/s with which parts strike that are thrown from rest, and that are locked.
    pub thrown: f32,
    /// See above.
    pub locked: f32,
    /// Whether parts were thrown by a kick as well.
    pub kicked: bool,
    /// RMS of the noise in the residual in m/s^2.
    pub noise: f32,
}

/// Whether nothing is heard where something must be.
#[derive(Clone, Copy, Debug, Default)]
pub struct Deafness {
    silent: u8,
    heard: u8,
    deaf: bool,
    crowd: bool,
}

impl Deafness {
    /// Whether it is deaf.
    pub fn is_deaf(&self) -> bool {
        self.deaf
    }

    /// Whether a part alone is too faint to be heard, however it strikes: what is heard are several at once, and of the others nothing is
    /// known. Of a crowd of 24 at 150 Hz a few that lock were heard alone, as one lock of all, in 5 of 60 runs.
    pub fn hears_crowds_only(&self) -> bool {
        self.crowd
    }

    /// Takes a cycle.
    pub fn cycle(&mut self, sound: &Sound) {
        let threshold = THRESHOLD * sound.noise;
        let loud = |speed: f32| RINGING * speed;
        self.crowd = sound.together && CLEARLY * BARE * sound.locked < threshold;
        // Where a lock itself is too quiet there is nothing to wait for, and what is heard is noise if it has no phase.
        let hopeless = loud(sound.locked) < threshold;
        let noise = self.crowd || hopeless && sound.concentration < REGULAR;
        if !sound.listening {
            *self = Self {
                crowd: self.crowd,
                ..Self::default()
            };
            return;
        }
        self.heard = if sound.rate > HEARD && !noise {
            self.heard.saturating_add(1)
        } else {
            0
        };
        if self.heard >= AGAIN || (self.heard > 0 && !self.deaf) {
            (self.silent, self.deaf) = (0, false);
            return;
        }
        if !sound.near {
            return;
        }
        let must = loud(sound.thrown) > CLEARLY * threshold
            || (sound.kicked && loud(sound.locked) > CLEARLY * threshold);
        if noise || (sound.rate < SILENT && (must || hopeless)) {
            self.silent = self.silent.saturating_add(1);
        } else if !self.deaf {
            self.silent = 0;
        }
        self.deaf |= self.silent >= PATIENCE;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOUND: Sound = Sound {
        listening: true,
        together: false,
        near: true,
        rate: 0.0,
        concentration: 0.0,
        thrown: 0.15,
        locked: 0.15,
        kicked: false,
        noise: 0.1,
    };

    fn deaf_after(cycles: u8, sound: &Sound) -> bool {
        let mut deafness = Deafness::default();
        (0..cycles).for_each(|_| deafness.cycle(sound));
        deafness.is_deaf()
    }

    #[test]
    fn silence_is_deafness_only_where_the_map_says_that_it_is_loud() {
        assert!(!deaf_after(31, &SOUND) && deaf_after(32, &SOUND));
        // Thrown from rest too softly to be heard, until a kick has thrown the parts.
        let soft = Sound {
            thrown: 0.1,
            ..SOUND
        };
        assert!(!deaf_after(200, &soft));
        let kicked = Sound {
            kicked: true,
            ..soft
        };
        assert!(deaf_after(32, &kicked));
        let off = Sound {
            near: false,
            ..SOUND
        };
        assert!(!deaf_after(200, &off));
        // Noise above what a lock gives.
        let noisy = Sound {
            noise: 0.3,
            ..SOUND
        };
        assert!(deaf_after(32, &noisy));
        for heard in [
            Sound { rate: 0.3, ..SOUND },
            Sound {
                listening: false,
                ..SOUND
            },
        ] {
            assert!(!deaf_after(200, &heard));
        }
    }

    #[test]
    fn noise_without_a_phase_is_no_hearing_where_a_lock_is_quieter() {
        let noisy = Sound {
            noise: 0.3,
            rate: 1.5,
            concentration: 0.3,
            ..SOUND
        };
        assert!(deaf_after(32, &noisy));
        let regular = Sound {
            concentration: 0.9,
            ..noisy
        };
        assert!(!deaf_after(200, &regular));
    }

    #[test]
    fn a_rhythm_is_none_of_a_part_that_is_too_faint() {
        let crowd = Sound {
            together: true,
            noise: 1.6,
            rate: 1.0,
            concentration: 1.0,
            ..SOUND
        };
        assert!(deaf_after(32, &crowd));
        let mut deafness = Deafness::default();
        for (sound, only) in [
            (crowd, true),
            (
                Sound {
                    noise: 1.4,
                    ..crowd
                },
                false,
            ),
            (
                Sound {
                    together: false,
                    ..crowd
                },
                false,
            ),
        ] {
            deafness.cycle(&sound);
            assert_eq!(deafness.hears_crowds_only(), only, "{sound:?}");
        }
    }

    #[test]
    fn it_ends_when_the_parts_are_heard_again() {
        let mut deafness = Deafness::default();
        (0..40).for_each(|_| deafness.cycle(&SOUND));
        let rate = |rate| Sound { rate, ..SOUND };
        (0..40).for_each(|_| deafness.cycle(&rate(0.4)));
        (0..15).for_each(|_| deafness.cycle(&rate(0.9)));
        assert!(deafness.is_deaf(), "some impacts are no hearing");
        deafness.cycle(&rate(0.9));
        assert!(!deafness.is_deaf());
    }
}
