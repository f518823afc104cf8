//! Scene files: strict TOML to a checked scene.

use kband::control::{Controller, NoSetpoint, Settings, StartCause, affordable_tones};
use kband::feeder::OutOfRange;
use kband::plant::{Change, DriveModel, Scene};
use toml::{Table, Value};

use super::engine::Fidelity;
use super::expect::Expectation;
use super::fields::{
    CONTROLLER, MASS, OUTPUT_MINIMUM, PLANT, SCATTER, SECTIONS, SENSOR, SENSOR_SETTINGS, belongs,
};
use super::parts::{self, Distribution};
use super::section::{Section, line_of};
use super::timeline::{describe, read_disturbances, read_target};
use crate::file;
use crate::refusal::Refusal;

/// The default scene, commented.
pub const DEFAULT: &str = include_str!("default.toml");

/// Largest safe amplitude of a scene that gives none, over what its hard limits allow.
const SAFE_SHARE: f32 = 0.5;

/// A scene as a file describes it.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// The scene itself.
    pub scene: Scene,
    /// Duration in s.
    pub duration: f64,
    /// Fidelity, if the file says.
    pub fidelity: Option<Fidelity>,
    /// What its parts are drawn from; `None` where they are given one by one.
    pub distribution: Option<Distribution>,
    /// What must come of it, if the file says.
    pub expectation: Option<Expectation>,
}

impl SceneFile {
    /// The scene of a text; one refusal that names the key, the value, what is accepted and what to
    /// do.
    pub fn parse(text: &str) -> Result<Self, Refusal> {
        Self::from_table(table(text)?).map_err(|refusal| at_line(refusal, text))
    }

    /// The scene of a table, as [`table`] gives it.
    pub fn from_table(table: Table) -> Result<Self, Refusal> {
        let drive = table.get("drive");
        let safe_given = drive.is_some_and(|drive| drive.get("safe_amplitude").is_some());
        let mut root = Section::new("", table);
        let mut settings = Settings::default();
        let mut scene = Scene::default();
        let duration = root.number("duration", 0.1..=86_400.0, "0.1..86400 s")?;
        let fidelity = match root.take("fidelity") {
            None => None,
            Some(value) => {
                let known = Fidelity::ALL.into_iter();
                let named = known
                    .clone()
                    .find(|known| value.as_str() == Some(known.name()));
                let names = known.map(Fidelity::name).collect::<Vec<_>>().join(", ");
                Some(named.ok_or_else(|| root.refuse("fidelity", &value, &names))?)
            }
        };
        if let Some(seed) = root.take("seed") {
            scene.seed = match seed {
                Value::Integer(seed) if seed >= 0 => seed as u64,
                other => return Err(root.refuse("seed", &other, "a whole number from 0")),
            };
        }
        if let Some(start) = root.take("start") {
            scene.start = match start.as_str() {
                Some("ordinary") => StartCause::Ordinary,
                Some("power-on") => StartCause::PowerOn,
                Some("reset") => StartCause::Reset,
                Some("refused") => StartCause::Refused,
                Some("repeated") => StartCause::Repeated,
                Some("image-damaged") => StartCause::ImageDamaged,
                _ => {
                    return Err(root.refuse(
                        "start",
                        &start,
                        "ordinary, power-on, reset, refused, repeated, image-damaged",
                    ));
                }
            };
        }
        for (name, keys, required) in SECTIONS {
            let mut section = root.section(name)?;
            for (n, key) in keys.iter().enumerate() {
                section.setting(&mut settings, key, n < required)?;
            }
            if name == "drive" {
                section.field(&OUTPUT_MINIMUM, &mut 0.0)?;
            }
            section.finish()?;
        }
        let mut part = root.section("part")?;
        if let Some(value) = part.take("friction") {
            scene.friction = Some(parts::read_friction(&part, &value)?);
            if let Some(kept) = part.take("tangential_restitution") {
                let accepted = "left out beside part.friction: the two are two models of one thing";
                return Err(part.refuse("tangential_restitution", &kept, accepted));
            }
            // Friction stops a locked part at every impact.
            settings.tangential_restitution = 0.0;
        }
        part.setting(&mut settings, "tangential_restitution", false)?;
        let (low, high) = part.interval("restitution")?;
        (settings.restitution_low, settings.restitution_high) = (low, high);
        scene.parts = core::iter::once(0.5 * (low + high)).collect();
        let distribution = match part.take("actual") {
            Some(value) => parts::read(&part, &value, &mut scene)?,
            None => None,
        };
        if let Some(value) = part.take(SCATTER.key) {
            parts::read_scatter(&part, &value, &mut scene)?;
            settings.scatter = configured_scatter(&scene.scatter);
        }
        if let Some(value) = part.take(MASS.key) {
            parts::read_masses(&part, &value, &mut scene)?;
        }
        if let Some(value) = part.take("hopper") {
            parts::read_hopper(&part, &value, &mut scene)?;
        }
        part.finish()?;
        if let Some(mut sensor) = root.optional("sensor")? {
            for key in SENSOR_SETTINGS {
                sensor.setting(&mut settings, key, false)?;
            }
            for (field, slot) in &SENSOR {
                sensor.field(field, slot(&mut scene))?;
            }
            sensor.finish()?;
        }
        if let Some(mut controller) = root.optional("controller")? {
            for key in CONTROLLER {
                controller.setting(&mut settings, key, false)?;
            }
            controller.finish()?;
        }
        if !safe_given {
            let most = SAFE_SHARE * settings.largest_safe_amplitude();
            settings.safe_amplitude = settings.safe_amplitude.min(most);
        }
        scene.drive = DriveModel {
            resonance: settings.resonance,
            quality: settings.quality,
            gain: settings.gain,
            ..DriveModel::default()
        };
        if settings.track_mass > 0.0 {
            scene.drive.mass = settings.track_mass;
        }
        if settings.second_tone > 0.0 {
            scene.drive.second_gain = settings.second_gain;
            scene.drive.second_lag = settings.second_lag;
            scene.drive.second_quality = settings.quality;
        }
        if settings.third_tone > 0.0 {
            scene.drive.third_gain = settings.third_gain;
            scene.drive.third_lag = settings.third_lag;
        }
        if let Some(mut plant) = root.optional("plant")? {
            for (field, slot) in &PLANT {
                plant.field(field, slot(&mut scene))?;
            }
            plant.finish()?;
        }
        let mut target = root.section("target")?;
        scene.target = read_target(&mut target)?;
        target.finish()?;
        scene.settings = settings;
        scene.disturbances = read_disturbances(&mut root, duration)?;
        let expectation = match root.optional("expect")? {
            Some(section) => Some(Expectation::read(section)?),
            None => None,
        };
        root.finish()?;
        let file = Self {
            scene,
            duration: f64::from(duration),
            fidelity,
            distribution,
            expectation,
        };
        file.check()?;
        Ok(file)
    }

    /// Whether the restitution of any part scatters at any time.
    #[must_use]
    pub fn scatters(&self) -> bool {
        let scene = &self.scene;
        let mut changes = scene
            .disturbances
            .iter()
            .map(|disturbance| disturbance.change);
        scene.scatter.iter().any(|s| *s > 0.0)
            || changes.any(|change| matches!(change, Change::Scatter(s) if s > 0.0))
    }

    /// Refuses what only shows once controller and drive are put together: a target that no
    /// amplitude of this drive can reach.
    pub fn check(&self) -> Result<(), Refusal> {
        let named = |refused: OutOfRange| {
            Refusal::value(
                refused.parameter,
                // The controller computes in f32: its digits are those that were written.
                refused.value as f32,
                refused.accepted,
                match belongs(refused.parameter) {
                    Some(table) => format!("set {table}.{} in the scene", refused.parameter),
                    None => format!("change {} in the scene", refused.parameter),
                },
            )
        };
        let settings = &self.scene.settings;
        if settings.third_tone > 0.0 && settings.second_tone == 0.0 {
            return Err(Refusal::value(
                "drive.third_tone",
                settings.third_tone,
                "0 without a second tone",
                "say drive.second_tone too, for example 0.25, or leave drive.third_tone out",
            ));
        }
        let configured = [
            (
                "drive.second_tone",
                settings.second_tone,
                "drive.second_gain",
            ),
            ("drive.third_tone", settings.third_tone, "drive.third_gain"),
        ];
        for ((key, tone, gain), affords) in
            configured.into_iter().zip(affordable_tones(settings, 1.0))
        {
            if tone > affords {
                return Err(Refusal::value(
                    key,
                    tone,
                    format!(
                        "0..{affords:.3}, which is what this drive's output makes where the track only just throws \
                         parts (k = 1)"
                    ),
                    format!("lower it, or raise {gain}, gain or output_maximum"),
                ));
            }
        }
        self.scene.check().map_err(named)?;
        let targets = self.scene.disturbances.iter();
        let later = targets.filter_map(|disturbance| match disturbance.change {
            Change::Target(target) => Some(target),
            _ => None,
        });
        for target in std::iter::once(self.scene.target).chain(later) {
            let mut controller =
                Controller::build(settings, target, self.scene.start).map_err(named)?;
            while !controller.chosen() && controller.plan_step() {}
            within_reach(&controller)?;
        }
        Ok(())
    }
}

/// Refused where the controller's drive does not reach what the target needs.
pub fn within_reach(controller: &Controller) -> Result<(), Refusal> {
    let needed = match controller.no_setpoint() {
        Some(NoSetpoint::Output { needed, .. }) => needed,
        _ => controller.setpoint() * 1e3,
    };
    let reach = controller.reach();
    if needed <= reach * 1e3 {
        return Ok(());
    }
    let next = "choose another target, or raise gain, output_maximum, amplitude_limit or acceleration_limit";
    let far = beside_resonance(controller.settings());
    Err(Refusal::value(
        format!("target {}", describe(controller.target())),
        format!("b = {needed:.4} mm"),
        format!(
            "b up to {:.4} mm (k from {:.4}), which is what this drive reaches within its limits",
            reach * 1e3,
            controller.k(reach)
        ),
        far.map_or_else(|| next.to_string(), |far| format!("{far}; {next}")),
    ))
}

/// What to do about a drive that runs so far beside its resonance that a tenth of its amplitude
/// there is left.
pub(super) fn beside_resonance(settings: &Settings) -> Option<String> {
    let x = f64::from(settings.frequency / settings.resonance);
    let q = f64::from(settings.quality);
    let answer = 1.0 / (q * (1.0 - x * x).hypot(x / q));
    (answer < 0.1).then(|| {
        format!(
            "the drive runs at {} Hz, far beside its resonance at {} Hz, where it answers with 1/{:.0} of the amplitude: \
             bring track.frequency and drive.resonance together",
            settings.frequency,
            settings.resonance,
            1.0 / answer
        )
    })
}

/// The refusal of a scene, preceded by the line of its text.
pub fn at_line(refusal: Refusal, text: &str) -> Refusal {
    match refusal.key().and_then(|key| line_of(text, key)) {
        Some(line) => refusal.at(format!("line {line}")),
        None => refusal,
    }
}

/// Configured scatter of the parts: their common one, else the root mean square.
fn configured_scatter(parts: &[f32]) -> f32 {
    match parts {
        [first, rest @ ..] if rest.iter().all(|s| s == first) => *first,
        _ => {
            let squares: f32 = parts.iter().map(|s| s * s).sum();
            (squares / parts.len().max(1) as f32).sqrt()
        }
    }
}

/// The table of a scene's text; refused with the line that is not TOML.
pub fn table(text: &str) -> Result<Table, Refusal> {
    file::toml(
        text,
        "correct this line; kband simulate --print-scene shows a whole scene",
    )
}

#[cfg(test)]
mod tests {
    use kband::control::Target;
    use kband::plant::Disturbance;

    use super::*;

    fn refusal(text: &str) -> String {
        match SceneFile::parse(text) {
            Ok(_) => panic!("accepted:\n{text}"),
            Err(refusal) => refusal.to_string(),
        }
    }

    #[test]
    fn the_default_scene_is_the_default() {
        let file = SceneFile::parse(DEFAULT).unwrap();
        // The paper's application, with parts that scatter.
        let mut expected = Scene {
            target: Target::Gear { order: 1 },
            ..Scene::default()
        };
        expected.settings.scatter = 0.04;
        // They slide; a locked one is stopped at every impact.
        expected.settings.tangential_restitution = 0.0;
        expected.friction = Some([0.3; 2]);
        expected.scatter = file.scene.parts.iter().map(|_| 0.04).collect();
        // Light enough to leave the track alone.
        expected.masses = file.scene.parts.iter().map(|_| 0.0).collect();
        assert_eq!(file.scene, expected);
        assert_eq!(file.duration, 10.0);
    }

    #[test]
    fn a_safe_amplitude_that_is_not_given_fits_the_limits() {
        let safe = |old: &str, new: &str| {
            let text = DEFAULT.replacen(old, new, 1);
            assert_ne!(text, DEFAULT);
            SceneFile::parse(&text).map(|file| file.scene.settings.safe_amplitude)
        };
        let tuned = DEFAULT
            .replace("frequency = 50.0 ", "frequency = 300.0 ")
            .replace("resonance = 50.0 ", "resonance = 300.0 ");
        // 120 m/s^2 at 300 Hz are 0.0338 mm.
        let fast = SceneFile::parse(&tuned).unwrap().scene.settings;
        assert!((fast.safe_amplitude - 0.0169).abs() < 1e-4, "{fast:?}");
        assert_eq!(safe("gain = 1.0 ", "gain = 0.9 "), Ok(0.05));
        let limit = "amplitude_limit = 1.0 ";
        assert_eq!(safe(limit, "amplitude_limit = 0.3 "), Ok(0.05));
        // A value that is given is taken as it is.
        let given = "safe_amplitude = 0.07\namplitude_limit = 1.0 ";
        assert_eq!(safe(limit, given), Ok(0.07));
        let given = tuned.replacen(limit, given, 1);
        let message = refusal(&given);
        assert!(
            message.contains("set drive.safe_amplitude in the scene"),
            "{message}"
        );
    }

    #[test]
    fn a_flow_asks_for_the_mass_and_length_of_the_track() {
        let mut text = DEFAULT.replace("\ngear = 1 ", "\nflow = 45.0 ");
        for (key, next) in [
            ("track_mass", "set drive.track_mass in the scene"),
            ("track_length", "set track.track_length in the scene"),
        ] {
            let message = refusal(&text);
            assert!(message.contains(next), "{message}");
            text = text.replacen(&format!("{key} = 0.0 "), &format!("{key} = 500.0 "), 1);
        }
        assert!(SceneFile::parse(&text).is_ok());
    }

    #[test]
    fn a_drive_far_from_its_resonance_is_refused() {
        let locked = DEFAULT.replace("\ngear = 1", "\nlocked = 1");
        assert!(SceneFile::parse(&locked).is_ok());
        let fast = locked.replace("frequency = 50.0", "frequency = 100.0");
        let slow = fast.replace("gain = 1.0 ", "gain = 0.1 ");
        let message = refusal(&slow);
        for said in [
            "100 Hz",
            "its resonance at 50 Hz",
            "1/75",
            "track.frequency",
        ] {
            assert!(message.contains(said), "{said}: {message}");
        }
    }

    #[test]
    fn the_line_of_a_key_is_found_in_tables_and_rows_of_tables() {
        let text = "a = 1\n\n[b]\nc = { d = 2 }\n[[e]]\nf = 3\n[[e]]\nf = 4\n";
        for (key, line) in [
            ("a", 1),
            ("[b]", 3),
            ("b.c", 4),
            ("b.c.d", 4),
            ("e 1.f", 6),
            ("e 2.f", 8),
        ] {
            assert_eq!(line_of(text, key), Some(line), "{key}");
        }
        assert_eq!(line_of(text, "z"), None);
    }

    #[test]
    fn each_bad_scene_is_refused_by_key_value_and_range() {
        for (old, new, expected) in [
            (
                "incline = 3.0",
                "incline = 90",
                &["track.incline = 90", "-60"][..],
            ),
            (
                "incline = 3.0",
                "",
                &["track.incline = (missing)", "add track.incline"],
            ),
            (
                "incline = 3.0",
                "inclin = 3.0\nincline = 3.0",
                &["track.inclin", "did you mean incline?"],
            ),
            (
                "incline = 3.0",
                "incline = \"steep\"",
                &["track.incline = \"steep\""],
            ),
            (
                "frequency = 50.0 ",
                "frequency = 0",
                &["track.frequency = 0", "5.0..500.0 Hz"],
            ),
            (
                "frequency = 50.0 ",
                "frequency = nan",
                &["track.frequency = NaN"],
            ),
            (
                "[0.18, 0.22]",
                "[0.18, 1.22]",
                &["part.restitution", "0 <= low <= high <= 1"],
            ),
            (
                "[0.18, 0.22]",
                "[0.22, 0.18]",
                &["part.restitution", "reversed"],
            ),
            ("[0.18, 0.22]", "nan", &["part.restitution = NaN"]),
            (
                "# actual = [0.2]",
                "actual = [0.2, -1]",
                &["part.actual = -1"],
            ),
            (
                "scatter = 0.04",
                "scatter = 0.31 #",
                &["part.scatter = 0.31", "0..0.3", "0.03 to 0.15"],
            ),
            (
                "scatter = 0.04",
                "scatter = [0.03, 0.05] #",
                &["part.scatter = [0.03, 0.05]", "one for each of the 1 parts"],
            ),
            (
                "scatter = 0.04",
                "scatter = \"some\" #",
                &["part.scatter = \"some\""],
            ),
            ("duration = 10.0", "", &["duration = (missing)"]),
            (
                "duration = 10.0",
                "duration = inf",
                &["duration = inf", "0.1..86400"],
            ),
            (
                "gear = 1 ",
                "",
                &["[target] says nothing", "exactly one of"],
            ),
            ("gear = 1 ", "gear = 0", &["target.gear = 0", "1..8"]),
            (
                "gear = 1 ",
                "gear = 1\nk = 0.4",
                &["target.k = 0.4", "exactly one of"],
            ),
            (
                "gear = 1 ",
                "k = 0.03",
                &["target k = 0.03", "b up to 0.95"],
            ),
            ("gear = 1 ", "amplitude = 1.5", &["target amplitude = 1.5"]),
            ("quality = 25.0", "quality = [1]", &["drive.quality = [1]"]),
            (
                "second_tone = 0.0 ",
                "second_tone = 0.6",
                &["drive.second_tone = 0.6", "0.0..0.5"],
            ),
            (
                "second_tone = 0.0                # largest second tone that the drive affords, over the first (e), 0..0.5 (optional)\nsecond_gain = 0.5",
                "second_tone = 0.15\nsecond_gain = 0.0",
                &[
                    "drive.second_tone = 0.15",
                    "0..0.11",
                    "raise drive.second_gain",
                ],
            ),
            (
                "third_tone = 0.0 ",
                "third_tone = 0.05",
                &[
                    "drive.third_tone = 0.05",
                    "0 without a second tone",
                    "drive.second_tone",
                ],
            ),
            (
                "second_tone = 0.0                # largest second tone that the drive affords, over the first (e), 0..0.5 (optional)\nsecond_gain = 0.5                # mm of track amplitude at twice the frequency for full output; 0: as the resonance has it (optional)\nsecond_lag = 90.0                # degrees of the track behind the output there (optional)\nthird_tone = 0.0                 # likewise at three times the frequency (e3); needs a second tone (optional)\nthird_gain = 0.25",
                "second_tone = 0.2\nthird_tone = 0.05\nthird_gain = 0.0",
                &[
                    "drive.third_tone = 0.05",
                    "0..0.0",
                    "raise drive.third_gain",
                ],
            ),
            (
                "gear = 1 ",
                "tones = [0.35, 0.15, 2.356]",
                &["target.tones", "degrees", "135.0"],
            ),
            (
                "gear = 1 ",
                "tones = [0.35, 0.15, 135]",
                &["second tone, ratio = 0.15", "what the drive affords"],
            ),
            ("[track]", "[track", &["line 9 is not TOML"]),
            (
                "duration = 10.0",
                "duration = 10.0\ntracks = 3",
                &["tracks = (unknown key)", "did you mean track?"],
            ),
            (
                "duration = 10.0",
                "duration = 10.0\nseed = 2",
                &["is not TOML", "duplicate"],
            ),
        ] {
            assert!(DEFAULT.contains(old), "{old}");
            let message = refusal(&DEFAULT.replacen(old, new, 1));
            for part in expected {
                assert!(message.contains(part), "{new:?}: {message}");
            }
        }
    }

    #[test]
    fn a_disturbance_is_a_time_and_one_change() {
        let with = |text: &str| format!("{DEFAULT}\n[[disturbance]]\n{text}\n");
        let file = SceneFile::parse(&with("at = 2.0\ntarget = { k = 0.4 }")).unwrap();
        assert_eq!(
            file.scene.disturbances[0],
            Disturbance {
                at: 2.0,
                change: Change::Target(Target::K(0.4))
            }
        );
        for (text, expected) in [
            ("at = 2.0", "has 0 changes"),
            ("at = 2.0\ngain = 0.7\nenable = false", "has 2 changes"),
            ("at = 20.0\ngain = 0.7", "disturbance 1.at = 20"),
            ("at = 2.0\ngain = -1", "disturbance 1.gain = -1"),
            ("at = 2.0\nenable = 1", "disturbance 1.enable = 1"),
            ("at = 2.0\nscatter = 0.5", "disturbance 1.scatter = 0.5"),
            ("gain = 0.7", "disturbance 1.at = (missing)"),
        ] {
            let message = refusal(&with(text));
            assert!(message.contains(expected), "{message}");
        }
    }
}
