//! Every column and every field of kband's outputs, with its unit: one name for one quantity in all
//! verbs.
//!
//! Verbs have only these columns. The numbers of a JSON document have only these names and those of
//! [`FIELDS`]; a test checks that. A name contains no unit. The unit is in a CSV's header, in a
//! Parquet's `units`, and in the `units` of the provenance.

use serde_json::{Map, Value as Json};

use super::table::Column;

macro_rules! columns {
    ($($constant:ident $name:literal $unit:literal $meaning:literal,)*) => {
        $(
            #[doc = $meaning]
            pub const $constant: Column = Column::new($name, $unit);
        )*

        /// Name, unit and meaning of every column.
        pub const COLUMNS: &[(&str, &str, &str)] = &[$(($name, $unit, $meaning)),*];
    };
    ($($name:literal $unit:literal $meaning:literal,)*) => {
        /// Name, unit and meaning of the other fields of JSON documents.
        pub const FIELDS: &[(&str, &str, &str)] = &[$(($name, $unit, $meaning)),*];
    };
}

columns! {
    TIME "time" "s" "Time from the start.",
    CYCLE "cycle" "" "Number of the drive cycle.",
    B "b" "mm" "Amplitude of the track's first tone, normal to the track.",
    K "k" "" "k = g cos(alpha) / (b w^2).",
    REFERENCE "reference" "mm" "Amplitude that the loop follows.",
    OUTPUT "output" "of full" "Output of the drive.",
    LEAD "lead" "rad" "Phase of the track before that of the output.",
    STATE "state" "" "State of the controller.",
    FAULT "fault" "" "Fault that stopped it.",
    LIMITS "limits" "" "Limits that hold it back, as bits.",
    IMPACTS_DETECTED "impacts_detected" "1/cycle" "Impacts detected.",
    PHASE_MEASURED "phase_measured" "rad" "Measured phase of the drive at impacts.",
    CONFIDENCE "confidence" "" "Confidence of the measured phase, 0..1.",
    IN_GEAR "in_gear" "" "Share of time in gear.",
    IN_GEAR_ESTIMATED "in_gear_estimated" "" "Estimated share of time in gear.",
    IN_GEAR_ERROR "in_gear_error" "" "Standard error of the estimated share.",
    IN_GEAR_COVERAGE "in_gear_coverage" "" "Share of the cycles with an estimate of the share in gear.",
    GEAR_BAND_LOW "gear_band_low" "" "Lower end of the gear band, in k.",
    GEAR_BAND_HIGH "gear_band_high" "" "Upper end of the gear band, in k.",
    GEAR_K "gear_k" "" "k with the largest predicted share of time in gear.",
    GEAR_B "gear_b" "mm" "Amplitude with the largest predicted share of time in gear.",
    GEAR_B_RANGE "gear_b_range" "mm" "Amplitudes of the gear band.",
    IN_GEAR_EXPECTED "in_gear_expected" "" "Share of time in gear that the plan expects.",
    IN_GEAR_LEAST "in_gear_least" "" "Share of time in gear of the worst part.",
    TRACE_ESTIMATED "trace_estimated" "" "Estimated trace of the map's derivative at the lock.",
    FLIP_ESTIMATED "flip_estimated" "" "Estimated distance of the lock to its flip: 1 plus its smaller multiplier.",
    RESTITUTION_ESTIMATED "restitution_estimated" "" "Estimated restitution.",
    RESTITUTION_ERROR "restitution_error" "" "Standard error of the estimated restitution.",
    SCATTER_ESTIMATED "scatter_estimated" "" "Estimated standard deviation of the restitution from impact to impact.",
    TO_LOSS_ESTIMATED "to_loss_estimated" "cycles" "Estimated mean time until gear is lost.",
    E "e" "of the first tone" "Amplitude of the second tone.",
    TH "th" "rad" "Phase angle of the second tone.",
    E3 "e3" "of the first tone" "Amplitude of the third tone.",
    TH3 "th3" "rad" "Phase angle of the third tone.",
    IMPACTS "impacts" "" "Number of impacts.",
    WAY "way" "mm" "Way of the parts along the track.",
    LOAD "load" "of the track's mass" "Mass of the parts that are on the track.",
    MASS "mass" "g" "Mass of the parts that are on the track.",
    MASS_WEIGHED "mass_weighed" "g" "Mass of the parts on the track, as the board weighs it by the drive's power.",
    FLOW_WEIGHED "flow_weighed" "g/s" "What leaves the track, as the board weighs it.",
    EVENTS "events" "" "Events of the cycle.",
    EVENT "event" "" "Event.",
    READING "reading" "codes" "Reading of the converter.",
    TRACK_DISPLACEMENT "track_displacement" "mm" "Displacement of the track, normal to it.",
    TRACK_VELOCITY "track_velocity" "mm/s" "Velocity of the track, normal to it.",
    RUN "run" "" "Number of the run.",
    RUNS "runs" "" "Number of runs.",
    CONTROL "control" "" "Way to control.",
    RESTITUTION "restitution" "" "Restitution of the part (R).",
    SCATTER "scatter" "" "Standard deviation of the restitution from impact to impact (s).",
    SENSOR_SENSITIVITY "sensor_sensitivity" "of the configured one" "Sensitivity of the accelerometer.",
    REACHED "reached" "s" "Time at which the wanted state was reached.",
    RUNS_REACHED "runs_reached" "" "Runs that reached the wanted state.",
    KICKS "kicks" "" "Kicks of the amplitude.",
    REGIME "regime" "" "Regime that it ends in.",
    SHARE "share" "" "Share, 0..1.",
    LOW_95 "low_95" "" "Lower end of the share's interval of 95 % confidence.",
    HIGH_95 "high_95" "" "Upper end of it.",
    MEDIAN_TIME "median_time" "s" "Time by which half of the runs that got there had got there.",
    SLOWEST_TIME "slowest_time" "s" "Time by which 95 of 100 of them had.",
    SPEED "speed" "mm/s" "Mean conveying speed, positive upwards.",
    SPEED_ERROR "speed_error" "mm/s" "Standard error of it.",
    IMPACT_MEAN "impact_mean" "mm/s" "Mean over impacts of the speed along the track.",
    CLOSED_FORM "closed_form" "mm/s" "Conveying speed of the lock in closed form.",
    BOUND "bound" "mm/s" "Bound on the conveying speed.",
    SPEED_AT_LOW_RESTITUTION "speed_at_low_restitution" "mm/s" "Speed in lock of the lot's dullest part.",
    SPEED_AT_HIGH_RESTITUTION "speed_at_high_restitution" "mm/s" "Speed in lock of its liveliest part.",
    VELOCITY "velocity" "b w" "Velocity in units of b w.",
    PHASE "phase" "rad" "Phase of the drive.",
    FLIGHT "flight" "rad" "Time of flight.",
    NEXT_PHASE "next_phase" "rad" "Phase of the drive at the impact.",
    NEXT_VELOCITY "next_velocity" "b w" "Velocity relative to the track just after it.",
    N "n" "" "Number of the impact.",
    LAUNCH "launch" "rad" "Phase at which the part is thrown off.",
    NEXT_LAUNCH "next_launch" "rad" "Phase at which it is thrown off next.",
    LANDING "landing" "rad" "Phase at which it lands.",
    REST "rest" "rad" "Time at rest on the track.",
    EQUATION "equation" "" "Equation of the paper.",
    SUBJECT "subject" "" "What it says.",
    PRINTED "printed" "" "As printed.",
    RECOMPUTED "recomputed" "" "As recomputed.",
    VERDICT "verdict" "" "Verdict.",
    RESIDUAL "residual" "" "Largest deviation over all cases.",
    TOLERANCE "tolerance" "" "Largest deviation that is accepted.",
    PRINTED_ERROR "printed_error" "" "Largest deviation of the printed values.",
    CASES "cases" "" "Cases that were computed.",
    HOLDS "holds" "" "Whether the recomputation holds.",
    START "start" "" "How the orbits were started.",
    STARTS "starts" "" "Number of starts.",
    POINTS "points" "" "Number of points.",
    FROM "from" "" "First value of a stretch, in the unit of the varied quantity.",
    TO "to" "" "Last value of it.",
    FROM_REST "from_rest" "" "Where a part ends that starts from rest, or whether it does so.",
    FROM_LOCK "from_lock" "" "Where a part ends that starts beside the lock.",
    EXPONENT "exponent" "1/impact" "Largest Lyapunov exponent.",
    EXPONENT_ERROR "exponent_error" "1/impact" "Standard error of it.",
    SECOND_EXPONENT "second_exponent" "1/impact" "Second Lyapunov exponent.",
    EXPONENT_PER_CYCLE "exponent_per_cycle" "1/cycle" "Largest Lyapunov exponent over the drive cycle.",
    EXPONENT_PER_CYCLE_ERROR "exponent_per_cycle_error" "1/cycle" "Standard error of it.",
    MEAN_FLIGHT "mean_flight" "cycles" "Mean time between impacts.",
    MOTION "motion" "" "Kind of motion.",
    REST_AFTER "rest_after" "impacts" "Impacts until the part rests.",
    MULTIPLIERS "multipliers" "" "Floquet multipliers of the closed orbit.",
    MULTIPLIER_MODULUS "multiplier_modulus" "" "Largest modulus of them.",
    PEAK "peak" "g" "Largest acceleration of the track.",
    FLIP "flip" "" "Impacts in the period, before and after.",
    GAP "gap" "" "Distance in k to the flip before.",
    RATIO "ratio" "" "Ratio of neighbouring gaps.",
    VISIBLE_BELOW "visible_below" "" "Largest scatter, relative to the mean, at which the doubling is seen.",
    SECTORS "sectors" "" "Sectors of the flash.",
    ADDRESS "address" "" "Address of the first.",
    SIZE "size" "KiB" "Their size.",
    IMAGE_SIZE "image_size" "bytes" "Bytes of the image in them.",
    WHAT "what" "" "Event, or quantity of the row.",
    POINT "point" "" "Point of the survey.",
    PERIODS_TO_LOSS "periods_to_loss" "periods" "Mean number of periods until gear is lost.",
    PERIODS_TO_LOSS_ERROR "periods_to_loss_error" "periods" "Standard error of that time, from the number of losses.",
    PERIODS_TO_CAPTURE "periods_to_capture" "periods" "Mean time from the start to the first gear.",
    IN_GEAR_AFTER_CAPTURE "in_gear_after_capture" "" "Share of time in gear after the first gear.",
    FORCE_RATIO_ON_RESONANCE "force_ratio_on_resonance" "" "Force of the second tone over that of the first, first tone on resonance.",
    ORDER "order" "" "Drive cycles per impact (r).",
    K2 "k2" "" "Lower end of the band.",
    K1 "k1" "" "Upper end of it.",
    K2_END "k2_end" "" "How the band ends below.",
    K1_END "k1_end" "" "How it ends above.",
    EMPTY "empty" "" "Whether there is no common band.",
    SETPOINT "setpoint" "" "k of the largest margin.",
    MARGIN "margin" "%" "Margin in amplitude to the nearer end of the band.",
    MARGIN_K "margin_k" "" "The same in k.",
    MARGIN_B "margin_b" "mm" "The same in amplitude.",
    B_AT_K1 "b_at_k1" "mm" "Amplitude at k1.",
    B_AT_K2 "b_at_k2" "mm" "Amplitude at k2.",
    THROW "throw" "" "Throw number 1/k.",
    CHAOS_EDGE "chaos_edge" "" "k below which the lot's first part is chaotic.",
    CHAOS_EDGE_ERROR "chaos_edge_error" "" "Its error.",
    CHAOS_EDGE_LAST_PART "chaos_edge_last_part" "" "k below which all of its parts are.",
    REACHABLE_EDGE "reachable_edge" "" "k up to which a part from rest locks by itself.",
    REACHABLE_HIGHEST "reachable_highest" "" "Largest k at which one does.",
    REACHABLE_SHARE "reachable_share" "" "Share of the band in which one does.",
    FROM_REST_LOW "from_rest_low" "" "Smallest k at which a part from rest locks.",
    FROM_REST_HIGH "from_rest_high" "" "Largest such k.",
    FROM_REST_SHARE "from_rest_share" "" "Share of the band in which it locks.",
    ALLOWING_HIGH_BOUND "allowing_high_bound" "" "Largest restitution for which there is a common band with the lot's smallest.",
    ALLOWING_LOW_BOUND "allowing_low_bound" "" "Smallest restitution for which there is one with its largest.",
    TARGET "target" "" "Requested target of the controller.",
    RECIPE "recipe" "" "Number of a recipe.",
    NAME "name" "" "Its name.",
    IN_USE "in_use" "" "Whether it is in use.",
    SECOND_TONE "second_tone" "of the first tone" "Largest second tone that the drive affords.",
    DEVIATION "deviation" "" "Standard deviation of the restitution.",
    HOPS "hops" "" "Hops detected.",
    GAIN_SCATTER "gain_scatter" "" "Scatter of the gain that was measured.",
    ATTEMPT "attempt" "" "Number of the attempt.",
    FACTOR "factor" "" "Amplitude of the kick over that of the target.",
    HOLD "hold" "cycles" "How long the kick holds it.",
    DESCENT "descent" "cycles" "How long it then falls.",
    RELEASE "release" "" "Factor to which it falls.",
    CAPTURED "captured" "" "Share of parts that is captured so far.",
    LAG "lag" "impacts" "Impacts in between.",
    AUTOCORRELATION "autocorrelation" "" "Autocorrelation of the time between impacts.",
    AUTOCORRELATION_ERROR "autocorrelation_error" "" "Standard error of it.",
    INCLINE "incline" "degrees" "Incline of the track.",
    FRICTION "friction" "" "Coefficient of friction.",
    PHASE_LEAD "phase_lead" "degrees" "Phase of the motion along the track before that normal to it (gamma).",
    IN_FLIGHT "in_flight" "" "Share of time in flight.",
    SLIDING_UP "sliding_up" "" "Share of time in which it slides upwards.",
    SLIDING_DOWN "sliding_down" "" "Share of time in which it slides downwards.",
    STILL "still" "" "Share of time at rest on the track.",
    CRITICAL_SLOPE "critical_slope" "degrees" "Incline on which a part in lock stands still.",
    INTERVAL "interval" "cycles" "Mean time between impacts.",
    SENSITIVITY "sensitivity" "" "Relative change of speed over relative change of amplitude.",
    SENSITIVITY_ERROR "sensitivity_error" "" "Standard error of it.",
    IMPACT_VELOCITY "impact_velocity" "b w" "Mean over impacts of the velocity along the track.",
    PARTS_PER_HOUR "parts_per_hour" "1/h" "Parts of the configured length.",
    ITEM "item" "" "Requested quantity.",
    VALUE "value" "" "Its value, in the unit beside it.",
    KEY "key" "" "Name of the setting.",
    REGISTER "register" "" "Address of the first register, from 0.",
    QUANTITY "quantity" "" "What a register holds.",
    FORM "form" "" "Form of a register's content.",
    WRITTEN "writable" "" "When it may be written.",
    MEANING "meaning" "" "Its meaning.",
    UNIT "unit" "" "Its unit.",
    LOW "low" "" "Lower end, in the unit of the value.",
    HIGH "high" "" "Upper end.",
    DEFAULT "default" "" "Value where nothing is said.",
    KERNEL "kernel" "" "Arithmetic of the map.",
    WORKLOAD "workload" "" "Kind of impacts.",
    IMPACT_TIME "impact_time" "ns" "CPU time of an impact, median of the rounds.",
    IMPACT_TIME_RANGE "impact_time_range" "ns" "Interquartile range of the CPU time over the rounds.",
    IMPACT_RATE "impact_rate" "1/s" "Impacts in a second.",
    MEDIAN_ERROR "median_error" "rad" "Median error of the phase.",
    P99_ERROR "p99_error" "rad" "Error that 99 of 100 phases keep.",
    MAX_ERROR "max_error" "rad" "Largest error of the phase.",
    WRONG_ROOTS "wrong_roots" "" "Impacts that are not the first one.",
    QUALITY "quality" "" "Quality factor of the drive (Q).",
    GAIN_RATIO "gain_ratio" "" "Gain of the drive over the configured one.",
    GAIN_MARGIN "gain_margin" "" "Gain margin of the amplitude loop.",
    GAIN_MARGIN_DETUNING "gain_margin_detuning" "" "Drive frequency over resonance less 1, where that is least.",
    PHASE_MARGIN "phase_margin" "degrees" "Phase margin of the amplitude loop.",
    PHASE_MARGIN_DETUNING "phase_margin_detuning" "" "Drive frequency over resonance less 1, where that is least.",
    B_RANGE "b_range" "mm" "Amplitudes from k1 to k2.",
    REACHED_FROM_REST "reached_from_rest" "" "Where a part from rest locks by itself.",
    ENDS "ends" "" "How the band ends, below and above.",
    FREQUENCY "frequency" "Hz" "Frequency of the drive.",
    THROW_ANGLE "throw_angle" "degrees" "Angle between the track and its motion.",
    PARTS_A_MINUTE "parts_a_minute" "1/min" "Parts of the configured length, end to end.",
    IN_GEAR_CLOSED_LOOP "in_gear_closed_loop" "" "Share of time in gear in the closed loop.",
    PARTS_A_MINUTE_CLOSED_LOOP "parts_a_minute_closed_loop" "1/min" "Parts a minute in the closed loop.",
    PARTS_BY_B "parts_by_b" "%/%" "Change of the parts a minute for 1 % more amplitude.",
    IN_GEAR_BY_B "in_gear_by_b" "1/%" "Change of the share in gear for 1 % more amplitude.",
    PARTS_BY_FREQUENCY "parts_by_frequency" "%/%" "Change of the parts a minute for 1 % more frequency at the same amplitude.",
    IN_GEAR_BY_FREQUENCY "in_gear_by_frequency" "1/%" "Change of the share in gear for 1 % more frequency at the same amplitude.",
    PARTS_BY_RESTITUTION "parts_by_restitution" "%" "Change of the parts a minute for a restitution larger by 0.01.",
    IN_GEAR_BY_RESTITUTION "in_gear_by_restitution" "" "Change of the share in gear for a restitution larger by 0.01.",
    SPEEDS "speeds" "mm/s" "Speed in lock, from the liveliest part to the dullest.",
}

columns! {
    "rows" "" "The rows.",
    "candidates" "" "Candidates that were tried.",
    "within_limits" "" "Candidates within the limits of the drive.",
    "held_by" "" "Limits of the drive and ends of the ranges that most of the best feeders reach.",
    "today" "" "The scene's own feeder with its own target.",
    "front" "" "Feeders of the Pareto front.",
    "table_error" "" "Deviation of the table from simulated parts, over the front.",
    "in_gear_rms" "" "Root mean square deviation of the share in gear.",
    "in_gear_max" "" "Largest deviation of the share in gear.",
    "speed_rms" "" "Root mean square relative deviation of the speed.",
    "speed_max" "" "Largest relative deviation of the speed.",
    "command" "" "Command that is run.",
    "restitution_low" "" "Smallest restitution of the lot.",
    "restitution_high" "" "Largest restitution of the lot.",
    "shares" "" "Share of each ending.",
    "over" "" "What the columns of the diagram run over.",
    "bands" "" "Where the period-1 orbit of an order attracts.",
    "regimes" "" "One entry for each regime.",
    "followed" "impacts" "Impacts for which each part was followed.",
    "summary" "" "The result in words.",
    "causes" "" "What keeps parts out of gear, and the share in gear that each remedy is predicted to give.",
    "band" "" "Band of the lock, its lower and upper end in k.",
    "gear_band" "" "Gear band, its lower and upper end in k: the share in gear is within 0.02 of the best.",
    "planned_for" "" "The lot that gear was planned for.",
    "margin_estimated" "" "Estimated margin to the loss of gear.",
    "to_loss" "cycles" "Mean time until gear is lost.",
    "lock_phase" "rad" "Phase at which parts in lock strike.",
    "restitution_identified" "" "Restitution that was found by listening.",
    "not_as_expected" "" "What of the scene's expectations was not met.",
    "picture" "" "File of the picture.",
    "trace" "" "File of the trace.",
    "scope" "" "File of the scope.",
    "fidelity" "" "How finely it was simulated.",
    "times_real_time" "" "Simulated time over the time it took.",
    "one_tone" "" "With the first tone alone.",
    "two_tones" "" "With the tones above it.",
    "flips" "" "k of each doubling.",
    "doubled" "" "The orbit born at each flip, in the middle of its window.",
    "ratios" "" "Ratios of neighbouring gaps.",
    "k_infinity" "" "k at which chaos begins.",
    "k_infinity_error" "" "Its error.",
    "complete" "" "Whether every requested flip was found.",
    "noise" "" "Scatter of the restitution, relative to its mean.",
    "visible" "" "Doublings that are seen with this noise.",
    "chip" "" "Microcontroller.",
    "image" "" "File of the image, or its version.",
    "flash_used" "bytes" "Flash that the image takes.",
    "ram_used" "bytes" "RAM that it takes, the stack included.",
    "option_bytes" "" "Option bytes that are set.",
    "written" "" "Whether it was written.",
    "force_ratio_off_resonance" "" "Force of the second tone over that of the first, first tone off resonance.",
    "third_force_ratio_on_resonance" "" "The same of the third tone, on resonance.",
    "third_force_ratio_off_resonance" "" "The same of the third tone, off resonance.",
    "seed" "" "Seed of the random numbers.",
    "periods_watched" "periods" "Periods for which each part was watched.",
    "band_middle" "" "At the middle of the lock's band.",
    "over_k" "" "Share in gear over k.",
    "applied" "" "Whether the board's settings were changed.",
    "best" "" "The best kick of the plan.",
    "kick" "" "A kick of the amplitude.",
    "tried" "" "Parts that were tried.",
    "locked" "" "Parts of them that were captured.",
    "plan" "" "What the plan took.",
    "set_ups" "" "Set-ups of the map.",
    "effort" "impacts" "Effort of the plan.",
    "attempts" "" "The kicks of the plan, one after the other.",
    "widest" "" "The kick in the middle of the map's widest patch.",
    "factor_margin" "" "By how much of itself the factor may be off.",
    "length_margin" "cycles" "By how much the length may be off.",
    "captured_alone" "" "Share of parts that the band alone captures.",
    "map" "" "Every kick of the map with the share of parts that it captures.",
    "histogram" "" "Times between impacts, counted.",
    "interval_low" "rad" "Lower end of a bin.",
    "interval_high" "rad" "Upper end of it.",
    "count" "" "How many there are.",
    "density" "1/rad" "Density of their distribution.",
    "mean_interval" "rad" "Mean time between impacts.",
    "mean_interval_error" "rad" "Standard error of it.",
    "interval_deviation" "rad" "Standard deviation of the time between impacts.",
    "lags" "" "Autocorrelation at each lag.",
    "k_low" "" "Smallest k.",
    "k_high" "" "Largest k.",
    "critical" "degrees" "Incline on which parts in lock stand still.",
    "velocity_bound" "b w" "Bound on the mean velocity along the track.",
    "lift_off" "rad" "Phase at which the track throws off what rests on it.",
    "rest_share" "" "Share of launches that lead to a rest.",
    "notes" "" "What stands out.",
    "board" "" "Name of the board.",
    "ready" "" "Whether READY is on.",
    "enable_input" "" "Whether the enable input is given.",
    "enable_desk" "" "Whether the desk permits.",
    "alarms" "" "Inputs that stop the drive while they are active.",
    "mean_acceleration" "m/s^2" "Mean reading of the accelerometer.",
    "setpoint_b" "mm" "Amplitude of the setpoint.",
    "running_time" "s" "Time since the start of the board.",
    "next" "" "What to do next.",
    "version" "" "Version of the link.",
    "schema" "" "Schema of the link.",
    "fits_this_desk" "" "Whether board and desk speak the same.",
    "self_test" "" "What the board found of itself.",
    "sensor" "" "Whether the accelerometer is at zero.",
    "settings" "" "Where the settings are from.",
    "stack_free" "bytes" "Stack that was never used.",
    "missed" "cycles" "Cycles that came late.",
    "brown_out" "mV" "Voltage below which the supply resets the board; 0 where it does not.",
    "hardware_watchdog" "" "Whether the watchdog starts with the power.",
    "sample_cost" "core cycles" "Largest cost of a sample.",
    "control_cost" "core cycles" "Largest cost of a control cycle.",
    "faults" "" "Faults that are kept.",
    "number" "" "Its number.",
    "b_expected" "mm" "Amplitude that was expected.",
    "last_words" "" "What a panic left.",
    "counters" "" "Frames by what came of them.",
    "requests" "" "Requests that were read.",
    "oversized" "" "Frames that were too long.",
    "corrupt" "" "Frames that were damaged.",
    "foreign" "" "Frames of another version.",
    "unknown" "" "Requests that are unknown.",
    "flooded" "" "Requests that came too fast.",
    "rows_dropped" "" "Rows of telemetry that did not fit the line.",
    "answers_dropped" "" "Answers that did not fit within 100 ms.",
    "access" "" "What the desk may do over the link.",
    "provenance" "" "Where the result is from.",
}

/// The units of a document's fields, by name.
pub(super) fn units_of(document: &Json) -> Map<String, Json> {
    let mut units = Map::new();
    collect(document, &mut units);
    units.sort_keys();
    units
}

fn collect(document: &Json, units: &mut Map<String, Json>) {
    match document {
        Json::Object(fields) => {
            for (name, value) in fields {
                if !units.contains_key(name)
                    && let Some((.., unit, _)) = entry(name)
                    && !unit.is_empty()
                {
                    units.insert(name.clone(), (*unit).into());
                }
                collect(value, units);
            }
        }
        Json::Array(values) => values.iter().for_each(|value| collect(value, units)),
        _ => {}
    }
}

/// Name, unit and meaning of a column or a field.
pub fn entry(name: &str) -> Option<&'static (&'static str, &'static str, &'static str)> {
    let mut all = COLUMNS.iter().chain(FIELDS);
    all.find(|(known, ..)| *known == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantity_has_one_name_and_the_name_no_unit() {
        let all: Vec<_> = COLUMNS.iter().chain(FIELDS).collect();
        for (n, (name, _, meaning)) in all.iter().enumerate() {
            assert!(
                all[..n].iter().all(|(other, ..)| other != name),
                "{name} is there twice"
            );
            let letters = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
            assert!(name.chars().all(letters), "{name}");
            assert!(meaning.ends_with('.'), "{name}");
            for unit in [
                "_mm", "_mm_s", "_percent", "_rad", "_hz", "_g", "_ms", "_mv", "_degrees",
            ] {
                assert!(!name.ends_with(unit), "{name}");
            }
        }
    }

    #[test]
    fn a_document_gets_the_units_of_its_fields() {
        let document = serde_json::json!({"rows": [{"b": 0.2, "k": 0.4, "kick": {"hold": 3}}]});
        let units = serde_json::json!({"b": "mm", "hold": "cycles"});
        assert_eq!(Json::Object(units_of(&document)), units);
    }
}
