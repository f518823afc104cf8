//! Scene files: strict TOML, checked.

use kband::feeder::OutOfRange;
use kband_control::{Controller, NoSetpoint, Settings, StartCause, Target, affordable_tones};
use kband_plant::{Change, DriveModel, Scene};
use toml::{Table, Value};

use super::engine::Fidelity;
use super::expect::Expectation;
use super::fields::{MASS, Model, PLANT, SCATTER, SENSOR, section_with, settings};
use super::parts::{self, Distribution};
use super::section::{Section, line_of};
use super::timeline::{describe, read_disturbances, read_target};
use crate::refusal::Refusal;

/// The default scene, commented.
pub const DEFAULT: &str = include_str!("default.toml");
/// Default safe amplitude as a share of the amplitude that the hard limits allow.
const MAX_SAFE_SHARE: f32 = 0.5;

/// A scene file.
#[derive(Clone, Debug)]
pub struct SceneFile {
    /// The scene.
    pub scene: Scene,
    /// Duration in s.
    pub duration: f64,
    /// Length of a part along the track in mm, for parts a minute.
    pub part_length: f64,
    /// Fidelity, if configured.
    pub fidelity: Option<Fidelity>,
    /// Distribution of the parts; `None` if they are given one by one.
    pub distribution: Option<Distribution>,
    /// Expected result, if configured.
    pub expectation: Option<Expectation>,
}

const STARTS: [(&str, StartCause); 6] = [
    ("ordinary", StartCause::Ordinary),
    ("power-on", StartCause::PowerOn),
    ("reset", StartCause::Reset),
    ("refused", StartCause::Refused),
    ("repeated", StartCause::Repeated),
    ("image-damaged", StartCause::ImageDamaged),
];

/// Default duration, s.
pub const DEFAULT_DURATION: f32 = 10.0;
/// Default length of a part, mm.
pub const DEFAULT_PART_LENGTH: f32 = 15.0;

impl SceneFile {
    /// Parses a scene. A refusal names the key, its value, the accepted range and the next step.
    pub fn parse(text: &str) -> Result<Self, Refusal> {
        Self::from_table(table(text)?).map_err(|refusal| at_line(refusal, text))
    }

    /// The scene of a table from [`table`].
    pub fn from_table(table: Table) -> Result<Self, Refusal> {
        let drive = table.get("drive");
        let safe_given = drive.is_some_and(|drive| drive.get("safe_amplitude").is_some());
        let mut root = Section::new("", table);
        let mut settings = Settings::default();
        let mut scene = Scene::default();
        let duration = if root.has("duration") {
            root.number("duration", 0.1..=86_400.0, "0.1..86400 s")?
        } else {
            DEFAULT_DURATION
        };
        let fidelity = match root.take("fidelity") {
            None => None,
            Some(value) => Some(root.choice("fidelity", &value, &Fidelity::ALL, Fidelity::name)?),
        };
        match root.take("seed") {
            None => {}
            Some(Value::Integer(seed @ 0..)) => scene.seed = seed as u64,
            Some(other) => return Err(root.refuse("seed", &other, "a whole number from 0")),
        }
        if let Some(start) = root.take("start") {
            (_, scene.start) = root.choice("start", &start, &STARTS, |(name, _)| name)?;
        }
        for name in ["track", "drive"] {
            read_table(root.section(name)?, name, &mut settings, &[], &mut scene)?;
        }
        let mut part = root.section("part")?;
        if let Some(value) = part.take("friction") {
            scene.friction = Some(parts::read_friction(&part, &value)?);
            if let Some(tangential) = part.take("tangential_restitution") {
                let accepted = "not together with part.friction: both are models of the motion along the track";
                return Err(part.refuse("tangential_restitution", &tangential, accepted));
            }
            // Friction stops a locked part at every impact.
            settings.tangential_restitution = 0.0;
        }
        part.setting(&mut settings, "tangential_restitution", false)?;
        part.setting(&mut settings, "contact", false)?;
        scene.contact = settings.contact;
        let (low, high) = part.interval("restitution")?;
        (settings.restitution_low, settings.restitution_high) = (low, high);
        scene.parts = core::iter::once(0.5 * (low + high)).collect();
        let distribution = match part.take("actual") {
            Some(value) => parts::read(&part, &value, &mut scene)?,
            None => None,
        };
        if let Some(value) = part.take(SCATTER.key) {
            let what = ", the standard deviation of restitution from impact to impact,";
            let examples = "; ordinary parts have 0.03 to 0.15, bodies that tumble 0.27 to 0.52";
            let words = [what, examples];
            scene.scatter = parts::one_or_each(&part, &SCATTER, &value, &scene, words)?;
            settings.scatter = configured_scatter(&scene.scatter).min(MAX_CONFIGURED_SCATTER);
        }
        if let Some(value) = part.take(MASS.key) {
            scene.masses = parts::one_or_each(&part, &MASS, &value, &scene, [" g,", ""])?;
        }
        if let Some(value) = part.take("hopper") {
            parts::read_hopper(&part, &value, &mut scene)?;
        }
        let part_length = if part.has("length") {
            part.number("length", 0.1..=1000.0, "0.1..1000 mm")?
        } else {
            DEFAULT_PART_LENGTH
        };
        part.finish()?;
        for (name, fields) in [("sensor", SENSOR), ("controller", &[])] {
            if let Some(table) = root.optional(name)? {
                read_table(table, name, &mut settings, fields, &mut scene)?;
            }
        }
        if !safe_given {
            let max_amplitude = MAX_SAFE_SHARE * settings.largest_safe_amplitude();
            settings.safe_amplitude = settings.safe_amplitude.min(max_amplitude);
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
        if settings.current_gain > 0.0 {
            scene.drive.current_gain = settings.current_gain;
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
        if let Some(table) = root.optional("plant")? {
            read_table(table, "plant", &mut settings, PLANT, &mut scene)?;
        }
        let mut target = root.section("target")?;
        scene.target = read_target(&mut target)?;
        target.finish()?;
        scene.settings = settings;
        scene.disturbances = read_disturbances(&mut root, duration)?;
        let expectation = root.optional("expect")?.map(Expectation::read);
        let expectation = expectation.transpose()?;
        root.finish()?;
        let file = Self {
            scene,
            duration: f64::from(duration),
            part_length: f64::from(part_length),
            fidelity,
            distribution,
            expectation,
        };
        file.check()?;
        Ok(file)
    }

    /// Whether the restitution of any part scatters at any time.
    pub fn scatters(&self) -> bool {
        let scene = &self.scene;
        let mut changes = scene.disturbances.iter();
        scene.scatter.iter().any(|s| *s > 0.0)
            || changes.any(|changed| matches!(changed.change, Change::Scatter(s) if s > 0.0))
    }

    /// Refuses a target that no amplitude of this drive reaches.
    pub fn check(&self) -> Result<(), Refusal> {
        let named = |refused: OutOfRange| {
            let key = refused.parameter;
            // The controller computes in f32: the message then has the digits of the file.
            let value = refused.value as f32;
            let next = match section_with(key) {
                Some(table) => format!("set {table}.{key} in the scene"),
                None => format!("change {key} in the scene"),
            };
            Refusal::value(key, value, refused.accepted, next)
        };
        let settings = &self.scene.settings;
        if settings.third_tone > 0.0 && settings.second_tone == 0.0 {
            let (key, accepted) = ("drive.third_tone", "0 without a second tone");
            let next =
                "set drive.second_tone too, for example to 0.25, or leave drive.third_tone out";
            return Err(Refusal::value(key, settings.third_tone, accepted, next));
        }
        let tones = [settings.second_tone, settings.third_tone];
        let configured = ["second", "third"].into_iter().zip(tones);
        for ((name, tone), affords) in configured.zip(affordable_tones(settings, 1.0)) {
            if tone > affords {
                let key = format!("drive.{name}_tone");
                let accepted = format!(
                    "0..{affords:.3}, which is what this drive's output makes where the track \
                     only just throws parts (k = 1)"
                );
                let next = format!("lower it, or raise drive.{name}_gain, gain or output_maximum");
                return Err(Refusal::value(key, tone, accepted, next));
            }
        }
        self.scene.check().map_err(named)?;
        for target in self.scene.targets() {
            let mut controller =
                Controller::build(settings, target, self.scene.start).map_err(named)?;
            // A search for gear considers only reachable amplitudes.
            let searches_gear = matches!(target, Target::Gear { .. } | Target::Flow(_));
            while !searches_gear && !controller.is_setpoint_found() && controller.plan_step() {}
            within_reach(&controller)?;
        }
        Ok(())
    }
}

/// Reads a table of settings and of numbers of the plant, and nothing else.
fn read_table(
    mut table: Section,
    name: &str,
    into: &mut Settings,
    fields: &[Model],
    scene: &mut Scene,
) -> Result<(), Refusal> {
    for (key, required) in settings(name) {
        table.setting(into, key, required)?;
    }
    for (field, slot) in fields {
        table.field(field, slot(scene))?;
    }
    table.finish()
}

/// Refuses a target beyond the reach of the controller's drive.
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
    let detuning_hint = describe_detuning(controller.settings());
    let key = format!("target {}", describe(controller.target()));
    let value = format!("b = {needed:.4} mm");
    let accepted = format!(
        "b up to {:.4} mm (k from {:.4}), which is what this drive reaches within its limits",
        reach * 1e3,
        controller.k(reach)
    );
    let next = detuning_hint.map_or(next.into(), |hint| format!("{hint}; {next}"));
    Err(Refusal::value(key, value, accepted, next))
}

/// Advice for a drive so far from its resonance that its response is below a tenth.
pub(crate) fn describe_detuning(settings: &Settings) -> Option<String> {
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

/// The refusal of a scene, with the number of the line in its text.
pub fn at_line(refusal: Refusal, text: &str) -> Refusal {
    match refusal.key().and_then(|key| line_of(text, key)) {
        Some(line) => refusal.at(format!("line {line}")),
        None => refusal,
    }
}

const MAX_CONFIGURED_SCATTER: f32 = 0.3;

/// Configured scatter of the parts: their common value, else the root mean square.
fn configured_scatter(parts: &[f32]) -> f32 {
    match parts {
        [first, rest @ ..] if rest.iter().all(|s| s == first) => *first,
        _ => {
            let squares: f32 = parts.iter().map(|s| s * s).sum();
            (squares / parts.len().max(1) as f32).sqrt()
        }
    }
}

/// Parses TOML; a refusal names the line and the next step.
pub fn toml_table(text: &str, next_step: &str) -> Result<toml::Table, Refusal> {
    text.parse().map_err(|error: toml::de::Error| {
        let start = error.span().map_or(0, |span| span.start.min(text.len()));
        let line = text[..start].matches('\n').count() + 1;
        let message = error.message().replace('\n', " ");
        Refusal::new(format!("line {line} is not TOML: {message}"), next_step)
    })
}

/// Parses the TOML of a scene; a refusal names the line.
pub fn table(text: &str) -> Result<Table, Refusal> {
    let next = "correct this line; kband simulate --print-scene shows a whole scene";
    toml_table(text, next)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(text: &str) -> String {
        SceneFile::parse(text).unwrap_err().to_string()
    }

    #[test]
    fn the_default_scene_is_the_default() {
        let file = SceneFile::parse(DEFAULT).unwrap();
        // The application in the paper, with restitution that scatters.
        let mut expected = Scene {
            target: Target::Gear { order: 1 },
            ..Scene::default()
        };
        expected.settings.scatter = 0.04;
        // Parts slide; friction stops a locked one at every impact.
        expected.settings.tangential_restitution = 0.0;
        expected.friction = Some([0.3; 2]);
        expected.scatter = file.scene.parts.iter().map(|_| 0.04).collect();
        // Masses too small to affect the track.
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
        let tuned = DEFAULT.replace("frequency = 50.0 ", "frequency = 300.0 ");
        let tuned = tuned.replace("resonance = 50.0 ", "resonance = 300.0 ");
        // 120 m/s^2 at 300 Hz are 0.0338 mm.
        let fast = SceneFile::parse(&tuned).unwrap().scene.settings;
        assert!((fast.safe_amplitude - 0.0169).abs() < 1e-4, "{fast:?}");
        assert_eq!(safe("gain = 1.0 ", "gain = 0.9 "), Ok(0.05));
        let limit = "amplitude_limit = 1.0 ";
        assert_eq!(safe(limit, "amplitude_limit = 0.3 "), Ok(0.05));
        // A configured value is used unchanged.
        let given = "safe_amplitude = 0.07\namplitude_limit = 1.0 ";
        assert_eq!(safe(limit, given), Ok(0.07));
        let given = tuned.replacen(limit, given, 1);
        let message = refusal(&given);
        let next = "set drive.safe_amplitude in the scene";
        assert!(message.contains(next), "{message}");
    }

    #[test]
    fn missing_duration_and_part_length_use_the_defaults() {
        let file = SceneFile::parse(DEFAULT).unwrap();
        let is_left_out = |line: &str| line.starts_with("duration") || line.starts_with("length");
        let left_out = DEFAULT.lines().filter(|line| !is_left_out(line));
        let left_out: Vec<&str> = left_out.collect();
        let without = SceneFile::parse(&left_out.join("\n")).unwrap();
        assert_eq!(without.duration, file.duration);
        assert_eq!(without.part_length, file.part_length);
        let long = DEFAULT.replace("length = 15.0", "length = 8.0");
        assert_eq!(SceneFile::parse(&long).unwrap().part_length, 8.0);
    }

    /// tests/wrong_inputs.txt has the lines of other keys.
    #[test]
    fn the_line_of_a_key_is_that_of_its_row() {
        let text = "[[e]]\nf = 3\n[[e]]\nf = 4\n";
        assert_eq!(line_of(text, "e 2.f"), Some(4));
    }
}
