//! Flights of one kind, gathered from lanes anywhere in the block.

use super::columns::Columns;
use super::lanes::Set;
use super::plan::{Kind, Plan};
use super::stages::{MAX_STAGED_LANES, Stages};
use crate::arithmetic::lane::{Lane, MAX_LANES, node_sum};
use crate::impact::double::first::{
    land_by_search, land_low_by_iteration, land_short_by_iteration,
};
use crate::impact::double::launch::{Launch, Track};
use crate::impact::double::step::Landing;
use crate::impact::double::{low, short, tall};

/// One impact of the queued lanes.
///
/// Registers of all kinds pass a stage together; in short queues one kind alone would wait for its
/// own results. A CPU holds only so many results at a time. So each stage is short, and the next
/// registers begin before the first is through.
#[inline(always)]
pub(super) fn advance<L: Lane>(
    columns: &mut Columns,
    stages: &mut Stages,
    now: &mut Plan,
    next: &mut Plan,
    resting: &mut Set,
    grazing: &mut Set,
) {
    let [talls, shorts, onces, lows] = &mut now.queues;
    let mut queues = [talls, shorts, onces, lows].map(|queue| queue.registers(L::WIDTH));
    let mut registers = [([0; MAX_LANES], 0); MAX_STAGED_LANES];
    loop {
        let mut count = 0;
        let mut ends = [0; 4];
        for kind in Kind::ALL {
            while count < MAX_STAGED_LANES / L::WIDTH
                && let Some(register) = queues[kind as usize].next()
            {
                registers[count] = register;
                begin::<L>(columns, stages, kind, count, register.0);
                count += 1;
            }
            ends[kind as usize] = count;
        }
        if count == 0 {
            return;
        }
        let [talls, shorts, onces, lows] = ends;
        for n in 0..talls {
            let (rounded, node) = stages.node_with_sum(n);
            let crossing = stages.crossing::<L>(n);
            let estimate = tall::approach_from(&stages.track(n), &crossing, rounded, node);
            stages.put_estimate(n, &estimate);
            stages.put_node_sum(n, estimate.next_node_sum());
        }
        for n in shorts..lows {
            let (rounded, node) = stages.node_with_sum::<L>(n);
            let estimate = low::approach_on(&stages.track(n), &stages.launch(n), rounded, node);
            stages.put_estimate(n, &estimate);
            stages.put_node_sum(n, estimate.next_node_sum());
        }
        for n in 0..talls {
            stages.compute_gap::<L>(n);
        }
        for n in shorts..lows {
            stages.compute_gap::<L>(n);
        }
        for n in 0..talls {
            let track = stages.track::<L>(n);
            let landing = stages.gap_near_impact(n).finish(&track);
            stages.put_landing(n, &landing);
        }
        for (n, register) in (talls..shorts).zip(&registers[talls..]) {
            let (landing, certain) =
                short::landing(&stages.track::<L>(n), &stages.launch(n), stages.guess(n));
            stages.put_landing(n, &landing);
            if L::any(!certain) {
                decide::<L>(
                    columns,
                    grazing,
                    stages,
                    n,
                    certain,
                    *register,
                    |track, launch, _| land_short_by_iteration(track, launch),
                );
            }
        }
        let mut open = UncertainLanes::EMPTY;
        for (n, register) in (shorts..lows).zip(&registers[shorts..]) {
            let stretch = stages.stretch::<L>(n);
            let (landing, certain) = low::landing_near(
                &stages.track::<L>(n),
                || columns.launch(register.0),
                &stretch,
                &stages.gap_near_impact(n),
            );
            stages.put_landing(n, &landing);
            if n >= onces && L::any(!stretch.certain) {
                open.add(n, L::bits(!stretch.certain), *register);
            }
            if L::any(!certain & stretch.certain) {
                let certain = certain | !stretch.certain;
                decide::<L>(
                    columns,
                    grazing,
                    stages,
                    n,
                    certain,
                    *register,
                    land_low_by_iteration,
                );
            }
        }
        open.land::<L>(columns, grazing, stages);
        for (n, &(lanes, _)) in registers[..count].iter().enumerate() {
            let landing = stages.landing::<L>(n);
            stages.put_next_launch(n, node_sum(landing.phase), columns.restitution(lanes));
        }
        for (n, &(lanes, _)) in registers[..count].iter().enumerate() {
            let landing = stages.landing::<L>(n);
            let after = stages.next_launch(n, &landing);
            stages.put_launch(n, &after);
            columns.land(lanes, landing.flight, &after);
        }
        for (n, &register) in registers[..count].iter().enumerate() {
            let (track, restitution) = (stages.track::<L>(n), stages.restitution(n));
            next.sort(resting, &track, restitution, &stages.launch(n), register);
        }
    }
}

/// Lanes of low flights that may barely clear a hump, gathered from their registers: each has only
/// a few.
struct UncertainLanes {
    lanes: [u8; MAX_STAGED_LANES + MAX_LANES],
    /// Register, place in it, and number of valid lanes of that register, for each lane.
    places: [[u8; 3]; MAX_STAGED_LANES],
    count: usize,
}

impl UncertainLanes {
    const EMPTY: Self = Self {
        lanes: [0; MAX_STAGED_LANES + MAX_LANES],
        places: [[0; 3]; MAX_STAGED_LANES],
        count: 0,
    };

    /// Adds the lanes of register `n` whose bits are set.
    fn add(&mut self, n: usize, bits: u32, (lanes, count): ([u8; MAX_LANES], usize)) {
        for (m, lane) in lanes.into_iter().enumerate().take(count) {
            if bits >> m & 1 == 1
                && let Some(place) = self.places.get_mut(self.count)
            {
                *place = [n as u8, m as u8, count as u8];
                self.lanes[self.count] = lane;
                self.count += 1;
            }
        }
    }

    /// Computes their landings.
    #[inline(always)]
    fn land<L: Lane>(&self, columns: &Columns, grazing: &mut Set, stages: &mut Stages) {
        for at in (0..self.count).step_by(L::WIDTH) {
            let places = &self.places[at..self.count.min(at + L::WIDTH)];
            let mut lanes = [self.lanes[at]; MAX_LANES];
            lanes[..places.len()].copy_from_slice(&self.lanes[at..at + places.len()]);
            let (landing, certain, stretch) =
                low::land_near_hump::<L>(&columns.track(lanes), &columns.launch(lanes));
            let (certain, has_stretch) = (L::bits(certain), L::bits(stretch.certain));
            let (flight, phase) = (landing.flight.to_array(), landing.phase.to_array());
            let (arrival, start) = (landing.arrival.to_array(), stretch.start.to_array());
            let (low, high) = (stretch.low.to_array(), stretch.high.to_array());
            for (m, (lane, place)) in lanes.into_iter().zip(places).enumerate() {
                let landing = if certain >> m & 1 == 1 {
                    Landing {
                        flight: flight[m],
                        phase: phase[m],
                        arrival: arrival[m],
                    }
                } else {
                    let all = [lane; MAX_LANES];
                    let (track, launch) = (columns.track(all), columns.launch(all));
                    let (landing, grazes) = if has_stretch >> m & 1 == 1 {
                        let stretch = low::Stretch {
                            start: start[m],
                            low: low[m],
                            high: high[m],
                            certain: f64::mask(1),
                        };
                        land_low_by_iteration(&track, &launch, stretch)
                    } else {
                        land_by_search(&track, &launch)
                    };
                    grazing.put(lane.into(), grazes);
                    landing
                };
                let [n, m, count] = place.map(usize::from);
                replace::<L>(stages, n, m, count, &landing);
            }
        }
    }
}

/// Stores the landing of lane `m` in register `n`, which has `count` valid lanes.
#[inline(always)]
fn replace<L: Lane>(stages: &mut Stages, n: usize, m: usize, count: usize, landing: &Landing<f64>) {
    stages.replace_landing::<L>(n, m, landing);
    if m + 1 == count {
        // The rest of the register repeats the last lane.
        for m in count..L::WIDTH {
            stages.replace_landing::<L>(n, m, landing);
        }
    }
}

/// First stage of register `n`.
#[inline(always)]
fn begin<L: Lane>(
    columns: &Columns,
    stages: &mut Stages,
    kind: Kind,
    n: usize,
    lanes: [u8; MAX_LANES],
) {
    let launch = columns.launch::<L>(lanes);
    let track = columns.track::<L>(lanes);
    stages.put_launch(n, &launch);
    stages.put_track(n, &track);
    match kind {
        Kind::Tall => {
            let crossing = tall::crossing(&track, &launch);
            stages.put_crossing(n, &crossing);
            stages.put_node_sum(n, crossing.node_sum());
        }
        Kind::Short => stages.put_guess(n, short::guess(&track, &launch)),
        Kind::Once => begin_in(
            stages,
            n,
            &launch,
            &low::find_single_stretch(&track, &launch),
        ),
        Kind::Low => begin_in(stages, n, &launch, &low::find_stretch(&track, &launch)),
    }
}

/// Stores the stretch of register `n`.
#[inline(always)]
fn begin_in<L: Lane>(stages: &mut Stages, n: usize, launch: &Launch<L>, stretch: &low::Stretch<L>) {
    stages.put_stretch(n, stretch);
    stages.put_node_sum(n, stretch.node(launch));
}

/// Landings of the lanes of register `n` that the closed forms cannot certify.
#[inline(always)]
fn decide<L: Lane>(
    columns: &Columns,
    grazing: &mut Set,
    stages: &mut Stages,
    n: usize,
    certain: L::Mask,
    (lanes, count): ([u8; MAX_LANES], usize),
    landing: impl Fn(&Track<f64>, &Launch<f64>, low::Stretch<f64>) -> (Landing<f64>, bool),
) {
    let certain = L::bits(certain);
    for (m, lane) in lanes.into_iter().enumerate().take(count) {
        if certain >> m & 1 == 0 {
            let all = [lane; MAX_LANES];
            let stretch = stages.stretch_of::<L>(n, m);
            let (landing, grazes) = landing(&columns.track(all), &columns.launch(all), stretch);
            replace::<L>(stages, n, m, count, &landing);
            grazing.put(lane.into(), grazes);
        }
    }
}
