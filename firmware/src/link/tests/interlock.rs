//! No request may start a machine, or clear a fault, a latch or a lock-out.

use super::draw::{below, choose, request, value};
use super::*;
use crate::testing::seed;
use kband::arithmetic::Noise;

const SEQUENCES: u32 = 100_000;
const MAX_SEQUENCE: u32 = 40;

fn setting(noise: &mut Noise) -> (&'static str, f32) {
    let key = &Settings::KEYS[below(noise, Settings::KEYS.len() as u32) as usize];
    let value = match below(noise, 3) {
        0 => key.default,
        1 => value(noise, key.low, key.high.min(4.0 * key.default + key.low)),
        _ => value(noise, key.low, key.high),
    };
    (key.name, value)
}

fn board_with_the_input_on(noise: &mut Noise) -> Board {
    use Condition::{Lost, Never, Whole};
    let loaded = LOADED(choose(noise, &[Whole, Never, Lost, Lost, Lost]));
    let start = choose(noise, &[StartCause::PowerOn, StartCause::Reset]);
    let mut board = Board::started(loaded, start);
    // Some boards run first, until the controller detects a track that does not move.
    if loaded.condition == Whole && below(noise, 4) == 0 {
        board.run(false, 31);
        board.run(true, 59);
        assert_eq!(board.state(), State::Fault);
    }
    board.enable = true;
    board
}

#[test]
fn no_request_closes_the_bridge_or_clears_a_fault() {
    let mut noise = Noise::new(seed(32));
    let (mut faults, mut answered, mut done) = (0, 0_u64, 0_u64);
    for sequence in 0..SEQUENCES {
        let mut board = board_with_the_input_on(&mut noise);
        let mut fault: Option<Fault> = None;
        let mut requests = Vec::new();
        for _ in 0..=below(&mut noise, MAX_SEQUENCE) {
            let setting = setting(&mut noise);
            let request = request(&mut noise, setting, 1);
            requests.push(request);
            let mut buffer = [0; MAX_FRAME_BYTES];
            let frame = write_request(&mut buffer, 7, &request).unwrap().to_vec();
            for answer in board.send(&frame) {
                answered += 1;
                done += u64::from(open(&answer).1 == Response::Done);
            }
            // A simulation ends after 10 s without requests: one step in twenty lasts a second.
            let second = below(&mut noise, 20) == 0;
            let inputs = Inputs {
                enable: true,
                stack_low: below(&mut noise, 40) == 0,
                supply_low: below(&mut noise, 40) == 0,
                ..Inputs::default()
            };
            for _ in 0..if second { 12 } else { 1 + below(&mut noise, 3) } {
                let cycle = sensed(if second { 20_000 } else { 400 });
                let Some(report) = board.station.cycle(&cycle, inputs) else {
                    continue;
                };
                assert_eq!(report.command.amplitude, 0.0, "{sequence}: {requests:?}");
                let holds = matches!(report.state, State::Off | State::Fault)
                    && (fault.is_none() || report.fault == fault);
                assert!(holds, "{sequence}: {fault:?}: {requests:?}: {report:?}");
                faults += u32::from(fault.is_none() && report.fault.is_some());
                fault = report.fault;
                let _ = board.service.tick(&board.station);
            }
        }
    }
    println!("{SEQUENCES} sequences, {answered} answers, {done} of them done, {faults} faults");
    assert!(faults > SEQUENCES / 2 && done > u64::from(SEQUENCES));
}

#[test]
fn a_strap_and_a_pin_make_the_link_read_only() {
    let set = Request::set("gain", 2.0);
    let pin = Pin::parse("0420").unwrap();
    let changes = [
        set,
        Request::Defaults,
        Request::Target(Target::K(0.5)),
        Request::Save,
        SIMULATE,
        Request::Samples {
            codes: &[],
            end: None,
        },
        Request::Lock(None),
        Request::SetRecipe {
            number: 1,
            recipe: None,
        },
        Request::SaveRecipes,
        Request::UseRecipe(1),
    ];
    let mut board = Board::new();
    board.done(&Request::Lock(Some(pin)));
    assert_eq!(board.saved().pin, Some(pin));
    for request in changes {
        board.refused(&request, Refusal::ReadOnly(Access::Locked));
    }
    board.done(&Request::Enable(false));
    board.done(&Request::Enable(true));
    board.done(&Request::Alive);
    let wrong = Request::Unlock(Pin::parse("0421").unwrap());
    board.refused(&wrong, Refusal::WrongPin);
    board.done(&Request::Unlock(pin));
    board.done(&set);
    // The next start locks it again; the strap overrides the PIN.
    let mut board = Board::started(board.saved(), StartCause::Ordinary);
    board.refused(&set, Refusal::ReadOnly(Access::Locked));
    board.done(&Request::Unlock(pin));
    board.service.image.strapped = || true;
    for request in changes {
        board.refused(&request, Refusal::ReadOnly(Access::Strapped));
    }
    assert_eq!(board.status().access, Access::Strapped);
    board.service.image.strapped = || false;
    board.done(&Request::Lock(None));
    assert_eq!(board.saved().pin, None);
    let mut board = Board::started(board.saved(), StartCause::Ordinary);
    board.done(&set);
}
