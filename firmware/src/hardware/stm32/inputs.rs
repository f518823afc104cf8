//! Inputs of the terminals: enable, thermal switch, recipe selection, and the strap of the link.

use super::bridge::broken;
use crate::board::Panel;
use crate::hardware::cortex::stack_low;
use crate::inputs::enable::Contact;
use cortex_m::peripheral::DWT;
use embassy_stm32::gpio::{AnyPin, Input, Pull};
use embassy_stm32::peripherals::{PB0, PB1, PC1, PC6, PC7, PC8};
use embassy_stm32::{Peri, pac};
use kband_control::Inputs;

/// Pin number of the enable input on port B; also its EXTI line.
const ENABLE: usize = 0;
const PORT_B: u8 = 1;
/// Number of the first pin on port C that selects a recipe: PC6 counts 1, PC7 2, PC8 4.
const FIRST_RECIPE_PIN: usize = 6;

/// The enable input since the last call.
#[inline]
pub(super) fn enable_contact() -> Contact {
    let edges = pac::EXTI.pr(0);
    let moved = edges.read().line(ENABLE);
    if moved {
        edges.write(|lines| lines.set_line(ENABLE, true));
    }
    let high = pac::GPIOB.idr().read().idr(ENABLE) == pac::gpio::vals::Idr::HIGH;
    match (moved, high) {
        (true, _) => Contact::Moved,
        (false, true) => Contact::Closed,
        (false, false) => Contact::Open,
    }
}

/// Inputs: enable on PB0 (3.3 V runs the drive), thermal switch on PB1 (to ground while cool).
pub struct Terminals {
    enable: Input<'static>,
    cool: Input<'static>,
    supply_low: fn() -> bool,
    clock_failed: bool,
    recipe: fn() -> u8,
}

impl Terminals {
    /// Sets up the inputs so that a broken wire stops the drive.
    pub fn new(
        enable: Peri<'static, PB0>,
        cool: Peri<'static, PB1>,
        supply_low: fn() -> bool,
        clock_failed: bool,
        recipe: fn() -> u8,
    ) -> Self {
        let enable = Input::new(enable, Pull::Down);
        pac::RCC.apb2enr().modify(|w| w.set_syscfgen(true));
        let lines = pac::SYSCFG.exticr(ENABLE / 4);
        lines.modify(|pins| pins.set_exti(ENABLE % 4, PORT_B));
        // EXTI latches each edge for the sample; its interrupt stays disabled in the NVIC.
        for edges in [pac::EXTI.rtsr(0), pac::EXTI.ftsr(0), pac::EXTI.imr(0)] {
            edges.modify(|lines| lines.set_line(ENABLE, true));
        }
        Self {
            supply_low,
            clock_failed,
            recipe,
            enable,
            cool: Input::new(cool, Pull::Up),
        }
    }
}

impl Panel for Terminals {
    fn inputs(&mut self) -> Inputs {
        Inputs {
            enable: self.enable.is_high(),
            over_temperature: self.cool.is_high(),
            stack_low: stack_low(),
            over_current: broken(),
            supply_low: (self.supply_low)(),
            clock_failed: self.clock_failed,
            ..Inputs::default()
        }
    }

    fn now(&self) -> u32 {
        DWT::cycle_count()
    }

    fn recipe(&mut self) -> Option<u8> {
        Some((self.recipe)())
    }
}

/// Configures PC1 as the strap of the link, and PC6, PC7 and PC8 as recipe inputs. Each is on while
/// it is wired to ground; the strap makes the link read-only.
pub fn pull_inputs_up(
    strap: Peri<'static, PC1>,
    one: Peri<'static, PC6>,
    two: Peri<'static, PC7>,
    four: Peri<'static, PC8>,
) {
    let pins: [Peri<'_, AnyPin>; 4] = [strap.into(), one.into(), two.into(), four.into()];
    // `forget` keeps the pull-ups while the program runs.
    core::mem::forget(pins.map(|pin| Input::new(pin, Pull::Up)));
}

/// Number of the recipe at these inputs now; 0 while all are open.
#[inline]
pub fn recipe_inputs() -> u8 {
    !(pac::GPIOC.idr().read().0 >> FIRST_RECIPE_PIN) as u8 & 7
}

/// Whether the strap of the link is wired to ground.
pub fn strapped() -> bool {
    pac::GPIOC.idr().read().idr(1) == pac::gpio::vals::Idr::LOW
}
