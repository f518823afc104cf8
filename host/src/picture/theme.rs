//! Colours for colour-blind readers (Okabe and Ito's set). Lightness, dashes, markers and hatches
//! also differ in grey prints.

use crate::report::finite;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Theme {
    /// Dark on white.
    #[default]
    Light,
    /// Light on dark.
    Dark,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Colour {
    pub rgb: [u8; 3],
    /// Opacity: 0 is invisible, 1 opaque.
    pub opacity: f32,
}

impl Colour {
    pub(super) const fn hex(rgb: u32) -> Self {
        let [_, red, green, blue] = rgb.to_be_bytes();
        Self {
            rgb: [red, green, blue],
            opacity: 1.0,
        }
    }

    pub(super) const fn with_opacity(self, opacity: f32) -> Self {
        Self { opacity, ..self }
    }

    pub(super) fn mix(self, other: Self, part: f64) -> Self {
        let mix = |n: usize| {
            let [from, to] = [self.rgb[n], other.rgb[n]].map(f64::from);
            (from + (to - from) * part).round() as u8
        };
        Self {
            rgb: std::array::from_fn(mix),
            opacity: 1.0,
        }
    }

    /// Relative luminance, 0 black to 1 white (WCAG 2).
    pub(super) fn luminance(self) -> f64 {
        let [red, green, blue] = self.rgb.map(|value| match f64::from(value) / 255.0 {
            dark if dark <= 0.04045 => dark / 12.92,
            light => ((light + 0.055) / 1.055).powf(2.4),
        });
        0.2126 * red + 0.7152 * green + 0.0722 * blue
    }
}

/// Class of a stretch of time or k, or of a point of a map: a colour with its hatch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Fill {
    /// At rest on the track, or drive off.
    Rest,
    /// Hops that end in rest and relaunch, or a transition of the drive.
    HopAndRest,
    Locked,
    /// Locked with a doubled period.
    Doubled,
    Periodic,
    Chaotic,
    Undecided,
    Fault,
}

impl Fill {
    /// All fills, in the order of their numbers.
    pub const ALL: [Self; 8] = [
        Self::Rest,
        Self::HopAndRest,
        Self::Locked,
        Self::Doubled,
        Self::Periodic,
        Self::Chaotic,
        Self::Undecided,
        Self::Fault,
    ];

    pub(super) fn colour(self, theme: Theme) -> Colour {
        match self {
            Self::Rest => theme.pick(0xF2F2F2, 0x262C33),
            Self::HopAndRest => theme.pick(0xCBD0D5, 0x59636E),
            Self::Locked => theme.pick(0x0B4F86, 0x3FA0DC),
            Self::Doubled => theme.pick(0x6FC0EE, 0xC4E8FC),
            Self::Periodic => theme.pick(0x00916A, 0x0E8F69),
            Self::Chaotic => theme.pick(0xE08A00, 0xF0B23A),
            Self::Undecided => theme.pick(0x33102A, 0x7A2E63),
            Self::Fault => theme.pick(0xB03A00, 0xFF6B2C),
        }
    }

    /// Slopes of the hatch lines, horizontal over vertical.
    pub(super) fn hatches(self) -> &'static [f64] {
        match self {
            Self::Rest | Self::HopAndRest | Self::Locked => &[],
            Self::Doubled => &[1.0],
            Self::Periodic => &[-1.0],
            Self::Chaotic | Self::Fault => &[1.0, -1.0],
            Self::Undecided => &[0.0],
        }
    }
}

impl Theme {
    fn pick(self, light: u32, dark: u32) -> Colour {
        Colour::hex(match self {
            Self::Light => light,
            Self::Dark => dark,
        })
    }

    pub(super) fn background(self) -> Colour {
        self.pick(0xFFFFFF, 0x14181D)
    }

    pub(super) fn text(self) -> Colour {
        self.pick(0x1A1A1A, 0xECECEC)
    }

    pub(super) fn muted(self) -> Colour {
        self.pick(0x565B61, 0xAAB2BB)
    }

    pub(super) fn grid(self) -> Colour {
        self.pick(0xE4E6E8, 0x2A3037)
    }

    pub(super) fn axis(self) -> Colour {
        self.pick(0x44494F, 0x9AA3AD)
    }

    pub(super) fn strip(self) -> Colour {
        match self {
            Self::Light => Colour::hex(0x0B5C94).with_opacity(0.13),
            Self::Dark => Colour::hex(0x3FA0DC).with_opacity(0.22),
        }
    }

    pub(super) fn series(self, n: usize) -> Colour {
        const LIGHT: [u32; 7] = [
            0x0072B2, 0xD55E00, 0x007A59, 0xB07800, 0x9C4A78, 0x3A9AD9, 0x222222,
        ];
        const DARK: [u32; 7] = [
            0x56B4E9, 0xF08A3C, 0x2FC79A, 0xF0E442, 0xE39AC4, 0x9AD7FF, 0xECECEC,
        ];
        self.pick(LIGHT[n % 7], DARK[n % 7])
    }

    /// A scale of monotone lightness from 0 to 1 (decreasing on paper), from points of cividis.
    pub(super) fn scale(self, part: f64) -> Colour {
        const ANCHORS: [u32; 9] = [
            0x00224E, 0x123570, 0x3B496C, 0x575D6D, 0x707173, 0x8A8678, 0xA59C74, 0xC3B369,
            0xFEE838,
        ];
        let place = 8.0 * finite(part).unwrap_or(0.0).clamp(0.0, 1.0);
        let n = (place as usize).min(7);
        Colour::hex(ANCHORS[n]).mix(Colour::hex(ANCHORS[n + 1]), place - n as f64)
    }

    /// Colour of a density from few to many points; both ends contrast with the background.
    pub(super) fn ink(self, part: f64) -> Colour {
        let (few, many) = (self.pick(0x8DB4D3, 0x2F6C98), self.pick(0x06243D, 0xE8F4FC));
        few.mix(many, part)
    }
}

/// Colours of both themes as CSS properties: `--text`, `--series0`, `--fill0`.
pub fn page_colours() -> String {
    let css = |theme: Theme| {
        let mut colours = vec![
            ("background".into(), theme.background()),
            ("text".into(), theme.text()),
            ("muted".into(), theme.muted()),
            ("grid".into(), theme.grid()),
            ("axis".into(), theme.axis()),
            ("strip".into(), theme.strip()),
        ];
        colours.extend((0..7).map(|n| (format!("series{n}"), theme.series(n))));
        colours.extend(Fill::ALL.map(|fill| (format!("fill{}", fill as u8), fill.colour(theme))));
        let line = |(name, colour): (String, Colour)| {
            let [red, green, blue] = colour.rgb;
            format!(" --{name}: rgba({red},{green},{blue},{});", colour.opacity)
        };
        colours.into_iter().map(line).collect::<String>()
    };
    let light = format!("{{{} color-scheme: light; }}\n", css(Theme::Light));
    let dark = format!("{{{} color-scheme: dark; }}\n", css(Theme::Dark));
    format!(
        ":root {light}@media (prefers-color-scheme: dark) {{ :root:not([data-theme=light]) {dark}}}\n:root[data-theme=dark] {dark}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_is_monotone_in_lightness() {
        let light = (0..=64).map(|n| Theme::Light.scale(f64::from(n) / 64.0).luminance());
        let light: Vec<f64> = light.collect();
        assert!(light.windows(2).all(|pair| pair[0] < pair[1]));
    }

    /// In grey (luma of ITU-R BT.601) regimes differ by a twelfth of the range from black to white.
    #[test]
    fn regimes_differ_on_a_grey_print() {
        let luma = |fill: Fill| {
            let [red, green, blue] = fill.colour(Theme::Light).rgb.map(f64::from);
            0.299 * red + 0.587 * green + 0.114 * blue
        };
        let lumas = Fill::ALL.into_iter().filter(|fill| *fill != Fill::Fault);
        let mut lumas: Vec<f64> = lumas.map(luma).collect();
        lumas.sort_by(f64::total_cmp);
        let mut steps = lumas.windows(2).map(|pair| pair[1] - pair[0]);
        assert!(steps.all(|step| step > 255.0 / 12.0), "{lumas:?}");
    }
}
