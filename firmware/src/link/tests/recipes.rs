//! Tests of the recipes over the link and at the inputs.

use super::*;

fn recipe(name: &str, target: Target, restitution: f32) -> (RecipeName, Recipe) {
    let settings = Settings {
        restitution_low: restitution - 0.02,
        restitution_high: restitution + 0.02,
        soft_start: 0.8,
        ..Settings::default()
    };
    let name = RecipeName::parse(name).unwrap();
    (name, Recipe::of(target, &settings))
}

fn set(number: u8, recipe: (RecipeName, Recipe)) -> Request<'static> {
    let recipe = Some(recipe);
    Request::SetRecipe { number, recipe }
}

fn delete(number: u8) -> Request<'static> {
    let recipe = None;
    Request::SetRecipe { number, recipe }
}

fn board() -> Board {
    let mut board = Board::new();
    board.done(&set(1, recipe("caps", Target::K(0.4), 0.3)));
    board.done(&set(6, recipe("M3", Target::Amplitude(0.2), 0.5)));
    board
}

fn stored(board: &mut Board, number: u8) -> Stored {
    match board.ask(&Request::Recipe(number)) {
        Response::Recipe(stored) => stored,
        other => panic!("{other:?}"),
    }
}

/// Target and restitution in use, and the number of the recipe.
fn in_use(board: &Board) -> (Target, f32, u8) {
    let (station, settings) = (&board.station, board.station.settings());
    let middle = 0.5 * (settings.restitution_low + settings.restitution_high);
    let middle = (middle * 1e3).round() * 1e-3;
    (station.target(), middle, station.recipe())
}

#[test]
fn recipes_are_set_saved_used_and_deleted() {
    let mut board = board();
    let (name, caps) = recipe("caps", Target::K(0.4), 0.3);
    assert_eq!(stored(&mut board, 1), Stored::Recipe(name, caps));
    assert_eq!(board.saved_recipes(), Recipes::default());
    board.done(&Request::SaveRecipes);
    let saved = board.saved_recipes();
    assert_eq!(saved.get(1), Stored::Recipe(name, caps));
    board.done(&Request::UseRecipe(6));
    assert_eq!(in_use(&board), (Target::Amplitude(0.2), 0.5, 6));
    // The machine's settings and target are the saved ones, with the recipe.
    assert_eq!(board.self_test().settings, SavedSettings::InUse);
    board.done(&Request::UseRecipe(0));
    assert_eq!(in_use(&board), (Target::Locked { order: 1 }, 0.2, 0));
    assert_eq!(board.self_test().settings, SavedSettings::InUse);
    board.done(&delete(6));
    board.refused(&Request::UseRecipe(6), Refusal::NoRecipe);
    board.done(&Request::SaveRecipes);
    assert_eq!(board.saved_recipes().get(6), Stored::None);
    for number in [0, 8, 255] {
        board.refused(&delete(number), Refusal::NoRecipe);
        assert_eq!(stored(&mut board, number), Stored::None);
    }
    board.refused(&Request::UseRecipe(8), Refusal::NoRecipe);
    // A separately set target is not a recipe.
    board.done(&Request::UseRecipe(1));
    board.done(&Request::Target(Target::K(0.5)));
    assert_eq!(in_use(&board), (Target::K(0.5), 0.3, 0));
}

#[test]
fn a_recipe_that_does_not_fit_the_machine_is_refused() {
    let mut board = board();
    let (name, mut invalid) = recipe("bad", Target::K(0.4), 0.3);
    invalid.values[0] = 0.9;
    board.out_of_range(&set(2, (name, invalid)), "restitution_high");
    let high = recipe("high", Target::Amplitude(1.5), 0.3);
    board.out_of_range(&set(2, high), "target amplitude");
    assert_eq!(stored(&mut board, 2), Stored::None);
    // It fitted before the machine's settings changed.
    board.done(&set(2, recipe("0.9 mm", Target::Amplitude(0.9), 0.3)));
    board.done(&Request::set("amplitude_limit", 0.5));
    board.out_of_range(&Request::UseRecipe(2), "target amplitude");
    assert_eq!(in_use(&board), (Target::Locked { order: 1 }, 0.2, 0));
}

#[test]
fn a_running_drive_uses_recipes_and_changes_none() {
    let mut board = board();
    board.run(false, 1);
    board.run(true, 1);
    assert_eq!(board.state(), State::Starting);
    board.refused(&set(2, recipe("M3", Target::K(0.4), 0.3)), Refusal::Running);
    board.refused(&delete(1), Refusal::Running);
    board.refused(&Request::SaveRecipes, Refusal::Running);
    board.done(&Request::UseRecipe(1));
    assert_eq!(in_use(&board), (Target::K(0.4), 0.3, 1));
    board.cycle();
    assert_eq!(board.state(), State::Starting);
    let mut records = (0..9).filter_map(|number| board.station.event(number));
    assert!(records.any(|record| record.event == Event::TargetSet.number()));
}

#[test]
fn inputs_select_when_they_change() {
    let mut board = board();
    board.station.follow_inputs(1);
    assert_eq!(in_use(&board), (Target::K(0.4), 0.3, 1));
    // The desk's choice holds until the inputs change.
    board.done(&Request::UseRecipe(6));
    board.station.follow_inputs(1);
    assert_eq!(in_use(&board), (Target::Amplitude(0.2), 0.5, 6));
    // A missing recipe: the previous target stays, and READY is off.
    board.station.follow_inputs(3);
    assert_eq!(in_use(&board), (Target::Amplitude(0.2), 0.5, 6));
    board.cycle();
    assert!(!board.station.ready());
    let events = board.station.report().events;
    assert!(events.iter().any(|event| event == Event::RecipeRefused));
    // While the desk simulates a plant, the inputs select nothing.
    board.done(&SIMULATE);
    board.station.follow_inputs(1);
    assert_eq!(board.station.recipe(), 6);
    board.refused(&Request::UseRecipe(1), Refusal::Running);
}
