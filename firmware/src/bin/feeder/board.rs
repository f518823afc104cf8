//! The board's pins and peripherals.

use cortex_m::peripheral::SCB;
use defmt_rtt as _;
use embassy_executor::Spawner;
use embassy_stm32::pac;

#[unsafe(no_mangle)]
extern "Rust" fn kband_drive_off() {
    // Without the main output enable the pins of the half bridge go to their idle level.
    pac::TIM1.bdtr().modify(|register| register.set_moe(false));
}

#[unsafe(no_mangle)]
extern "Rust" fn kband_halt() -> ! {
    SCB::sys_reset()
}

#[embassy_executor::main]
async fn main(_spawner: Spawner) {
    let _peripherals = embassy_stm32::init(embassy_stm32::Config::default());
    defmt::info!("kband {}", kband_firmware::cortex::IDENTITY);
    core::future::pending::<()>().await;
}
