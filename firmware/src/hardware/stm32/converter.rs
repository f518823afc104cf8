//! The converter of acceleration and current, and the enable input of each sample.

use super::inputs::enable_contact;
use crate::board::Sense;
use crate::inputs::enable::Contact;
use embassy_stm32::adc::{Adc, AdcChannel, InjectedAdc, SampleTime};
use embassy_stm32::peripherals::{ADC1, PA1, PC0};
use embassy_stm32::{Peri, pac};
use kband_control::AdcCode;

/// The accelerometer on PA1, converted at TIM1's update, then the current sensor on PC0.
pub struct Converter {
    _sequence: InjectedAdc<'static, ADC1, 2>,
}

impl Converter {
    /// Sets up the converter, with an interrupt at the end of each conversion.
    pub fn new(
        converter: Adc<'static, ADC1>,
        accelerometer: Peri<'static, PA1>,
        current: Peri<'static, PC0>,
        sample_time: SampleTime,
    ) -> Self {
        let channels = [accelerometer.degrade_adc(), current.degrade_adc()];
        Self {
            _sequence: converter.setup_injected_conversions(
                channels.map(|channel| (channel, sample_time)),
                embassy_stm32::triggers::TIM1_TRGO,
                pac::adc::vals::Exten::RISING_EDGE,
                true,
            ),
        }
    }
}

impl Sense for Converter {
    #[inline]
    fn sample(&mut self) -> AdcCode {
        AdcCode(pac::ADC1.jdr(0).read().jdata())
    }

    #[inline]
    fn current(&mut self) -> AdcCode {
        AdcCode(pac::ADC1.jdr(1).read().jdata())
    }

    #[inline]
    fn enable(&mut self) -> Option<Contact> {
        Some(enable_contact())
    }
}
