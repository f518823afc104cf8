//! Model of a converter: one triggered group of injected conversions, regular ones by software
//! (RM0090, chapter 13).

/// Bits of SR and CR2.
const REGULAR_END: u32 = 1 << 1;
const INJECTED_END: u32 = 1 << 2;
const INJECTED_START: u32 = 1 << 3;
const REGULAR_START: u32 = 1 << 4;
const ON: u32 = 1;
const RIGHT_TO_LEFT: u32 = 1 << 11;
const START_INJECTED: u32 = 1 << 22;
const START: u32 = 1 << 30;
/// Sampling times by code (13.13.5) and conversion time, cycles.
const SAMPLING: [u32; 8] = [3, 15, 28, 56, 84, 112, 144, 480];

/// Registers of ADC1 and those that the three converters share.
#[derive(Clone, Debug)]
pub struct Converter {
    words: [u32; 20],
    prescaler: u32,
    /// End ticks of the running injected group and of the regular conversion.
    injected: u64,
    regular: u64,
}

impl Default for Converter {
    fn default() -> Self {
        Self {
            words: [0; 20],
            prescaler: 0,
            injected: u64::MAX,
            regular: u64::MAX,
        }
    }
}

impl Converter {
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Reads a register; from `offset` 0x300 on those that the three converters share.
    pub fn read(&mut self, offset: u32) -> u32 {
        match offset {
            0x304 => self.prescaler,
            0x4c => {
                self.words[0] &= !REGULAR_END;
                self.words[0x4c / 4]
            }
            offset => self.words.get(offset as usize / 4).copied().unwrap_or(0),
        }
    }

    /// Writes a register at tick `now`; an APB2 cycle takes `cycle` ticks.
    pub fn write(&mut self, offset: u32, value: u32, now: u64, cycle: u64) {
        match offset {
            0x00 => self.words[0] &= value,
            0x304 => self.prescaler = value,
            0x08 => {
                self.words[2] = value & !(START | START_INJECTED);
                if value & ON != 0 && value & START != 0 {
                    self.words[0] |= REGULAR_START;
                    let channel = self.words[0x34 / 4] & 0x1f;
                    self.regular = now + self.time(channel, cycle);
                }
                if value & ON != 0 && value & START_INJECTED != 0 {
                    self.begin(now, cycle);
                }
            }
            0x3c..=0x4c => {}
            offset => {
                if let Some(word) = self.words.get_mut(offset as usize / 4) {
                    *word = value;
                }
            }
        }
    }

    /// Duration of one conversion, ticks.
    fn time(&self, channel: u32, cycle: u64) -> u64 {
        let (word, shift) = if channel >= 10 {
            (self.words[3], 3 * (channel - 10))
        } else {
            (self.words[4], 3 * channel)
        };
        let sampling = SAMPLING[(word >> shift & 7) as usize];
        let bits = 12 - 2 * (self.words[1] >> 24 & 3);
        let divider = 2 * ((self.prescaler >> 16 & 3) + 1);
        u64::from((sampling + bits) * divider) * cycle
    }

    /// Ticks from a trigger to the end of the group's first sample. Three converter cycles for the
    /// trigger (DS8626, table 67), then the sampling time.
    pub fn samples(&self, cycle: u64) -> u64 {
        let channel = self.group().first().copied().unwrap_or(0);
        let bits = 12 - 2 * (self.words[1] >> 24 & 3);
        let divider = 2 * ((self.prescaler >> 16 & 3) + 1);
        self.time(channel, cycle) + 3 * u64::from(divider) * cycle
            - u64::from(bits * divider) * cycle
    }

    /// Channels of the injected group in order (13.13.12).
    fn group(&self) -> Vec<u32> {
        let word = self.words[0x38 / 4];
        let last = word >> 20 & 3;
        (0..=last)
            .map(|rank| word >> (5 * (3 - last + rank)) & 0x1f)
            .collect()
    }

    fn begin(&mut self, now: u64, cycle: u64) {
        self.words[0] |= INJECTED_START;
        let times = self
            .group()
            .into_iter()
            .map(|channel| self.time(channel, cycle));
        self.injected = now + times.sum::<u64>();
    }

    /// Handles TIM1's trigger: starts the group where it is enabled and none is running.
    pub fn trigger(&mut self, now: u64, cycle: u64) {
        let control = self.words[2];
        let asked = control >> 16 & 0xf == 1 && control >> 20 & 1 == 1;
        if control & ON != 0 && asked && self.injected == u64::MAX {
            self.begin(now, cycle);
        }
    }

    /// Tick at which a conversion ends.
    pub fn due(&self) -> u64 {
        self.injected.min(self.regular)
    }

    /// Ends the conversions due by `now` with the readings `level` of each channel, 0 to 4095.
    /// Returns whether the injected group ended.
    pub fn end(&mut self, now: u64, mut level: impl FnMut(u32) -> u16) -> bool {
        let cut = 2 * (self.words[1] >> 24 & 3);
        let mut convert = |control: u32, channel: u32| {
            let value = u32::from(level(channel)) >> cut;
            if control & RIGHT_TO_LEFT != 0 {
                value << 4
            } else {
                value
            }
        };
        let control = self.words[2];
        if now >= self.regular {
            let value = convert(control, self.words[0x34 / 4] & 0x1f);
            self.words[0x4c / 4] = value;
            self.words[0] |= REGULAR_END;
            self.regular = u64::MAX;
        }
        if now < self.injected {
            return false;
        }
        let group = {
            let word = self.words[0x38 / 4];
            let last = word >> 20 & 3;
            (0..=last).map(move |rank| word >> (5 * (3 - last + rank)) & 0x1f)
        };
        let mut values = [0; 4];
        for (place, channel) in values.iter_mut().zip(group) {
            *place = convert(control, channel);
        }
        for (rank, value) in values.into_iter().enumerate() {
            let zero = self.words[0x14 / 4 + rank] & 0xfff;
            self.words[0x3c / 4 + rank] = value.wrapping_sub(zero) & 0xffff;
        }
        self.words[0] |= INJECTED_END;
        self.injected = u64::MAX;
        true
    }

    /// Whether it requests its interrupt: end of a regular conversion, or of the injected group.
    pub fn interrupts(&self) -> bool {
        let (status, control) = (self.words[0], self.words[1]);
        status & REGULAR_END != 0 && control >> 5 & 1 == 1
            || status & INJECTED_END != 0 && control >> 7 & 1 == 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trigger_converts_the_injected_group_and_interrupts() {
        let mut converter = Converter::default();
        let cycle = 12;
        converter.write(0x304, 1 << 16, 0, cycle);
        converter.write(0x04, 1 << 7 | 1 << 8, 0, cycle);
        converter.write(0x10, 3 << 3, 0, cycle);
        // One conversion: the last entry of the sequence.
        converter.write(0x38, 1 << 15, 0, cycle);
        converter.trigger(0, cycle);
        assert_eq!(converter.due(), u64::MAX, "it is off");
        converter.write(0x08, ON | 1 << 16 | 1 << 20, 0, cycle);
        converter.trigger(100, cycle);
        // 56 + 12 cycles of 84 MHz / 4.
        assert_eq!(converter.due(), 100 + 68 * 4 * cycle);
        assert!(!converter.interrupts());
        assert!(converter.end(converter.due(), |channel| 1000 + channel as u16));
        assert_eq!(converter.read(0x3c), 1001);
        assert!(converter.interrupts());
        converter.write(0x00, !INJECTED_END, 0, cycle);
        assert!(!converter.interrupts());
    }

    #[test]
    fn the_ranks_of_a_group_follow_each_other() {
        let mut converter = Converter::default();
        // Channel 1, then channel 10, both with 28 cycles of sampling time.
        converter.write(0x10, 2 << 3, 0, 12);
        converter.write(0x0c, 2, 0, 12);
        converter.write(0x38, 1 << 20 | 1 << 10 | 10 << 15, 0, 12);
        converter.write(0x08, ON | 1 << 16 | 1 << 20, 0, 12);
        converter.trigger(0, 12);
        // The first channel's sampling time, at half of the clock.
        assert_eq!(converter.samples(12), (3 + 28) * 2 * 12);
        assert_eq!(converter.due(), 2 * 40 * 2 * 12);
        assert!(converter.end(converter.due(), |channel| 100 * channel as u16));
        assert_eq!((converter.read(0x3c), converter.read(0x40)), (100, 1000));
    }

    #[test]
    fn a_regular_conversion_is_started_by_the_program_and_read_once() {
        let mut converter = Converter::default();
        converter.write(0x34, 17, 0, 12);
        converter.write(0x08, ON | START, 0, 12);
        assert_eq!(converter.due(), (3 + 12) * 2 * 12);
        assert!(!converter.end(1_000_000, |channel| 100 * channel as u16));
        assert_eq!(converter.read(0) & REGULAR_END, REGULAR_END);
        assert_eq!(converter.read(0x4c), 1700);
        assert_eq!(converter.read(0) & REGULAR_END, 0);
    }
}
