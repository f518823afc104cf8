//! Connects to a chip through a debug probe, and reads its memory while its program runs.

use probe_rs::architecture::arm::dp::DpAddress;
use probe_rs::architecture::arm::sequences::DefaultArmSequence;
use probe_rs::architecture::arm::{ArmDebugInterface, ArmError, FullyQualifiedApAddress};
use probe_rs::probe::list::Lister;
use probe_rs::probe::{DebugProbeInfo, DebugProbeSelector, Probe, WireProtocol};
use probe_rs::{Permissions, Session};

use super::model::Chip;
use crate::refusal::{Refusal, Result};

/// Identity register of a chip (RM0090, 38.6.1; RM0440, 47.6.1).
const IDENTITY: u32 = 0xe004_2000;
const FAMILY: u32 = 0xfff;
const WIRES: &str = "check SWDIO, SWCLK, ground and the board's supply";

/// A connected chip of the expected family. Only [`ConnectedChip::control`] stops its core.
pub struct ConnectedChip {
    interface: Box<dyn ArmDebugInterface>,
    memory: FullyQualifiedApAddress,
    probe: String,
    chip: &'static Chip,
}

impl ConnectedChip {
    /// Connects to the chip on the named or only probe; refuses another family or flash size.
    pub fn connect(requested: Option<&str>, chip: &'static Chip) -> Result<Self> {
        let info = find(requested)?;
        let name = name(&info);
        let mut probe = info.open().map_err(|error| {
            let cause = format!("the probe {name} does not open: {}", causes(&error));
            let next = "close other programs that use it, and check your permissions";
            Refusal::new(cause, format!("{next} (on Linux its udev rule)"))
        })?;
        let unreached = |error: &dyn std::error::Error| {
            let why = causes(error);
            Refusal::new(
                format!("the probe {name} does not reach the chip: {why}"),
                WIRES,
            )
        };
        let selected = probe.select_protocol(WireProtocol::Swd);
        selected.map_err(|error| unreached(&error))?;
        let attached = probe.attach_to_unspecified();
        attached.map_err(|error| unreached(&error))?;
        let interface = probe.try_into_arm_debug_interface(DefaultArmSequence::create());
        let mut interface = interface.map_err(|(_, error)| unreached(&error))?;
        let selected = interface.select_debug_port(DpAddress::Default);
        selected.map_err(|error| unreached(&error))?;
        let mut reached = Self {
            interface,
            memory: FullyQualifiedApAddress::v1_with_default_dp(0),
            probe: name.clone(),
            chip,
        };
        reached.identify()?;
        Ok(reached)
    }

    fn identify(&mut self) -> Result<()> {
        let family = self.word(IDENTITY)? & FAMILY;
        let size = (self.chip.flash.end - self.chip.flash.start) / 1024;
        let mut chip = format!("family {family:#05x}");
        // Only the expected family has its flash size at this address.
        if family == self.chip.family {
            let mut half = [0; 2];
            self.read(self.chip.flash_size, &mut half)?;
            let kib = u32::from(u16::from_le_bytes(half));
            if kib >= size {
                return self.look_at_division();
            }
            chip += &format!(" with {kib} KiB of flash");
        }
        let accepted = format!(
            "{:#05x} with {size} KiB: {}, for which the image is",
            self.chip.family, self.chip.name
        );
        let next = "nothing was changed: check that this is the right board, or give its image";
        Err(Refusal::value("chip", chip, accepted, next))
    }

    /// Refuses a flash that an option byte divides into other sectors than the image assumes.
    fn look_at_division(&mut self) -> Result<()> {
        let Some((address, bit)) = self.chip.divided else {
            return Ok(());
        };
        if self.word(address)? & bit != 0 {
            return Ok(());
        }
        let cause = "the flash of this chip is one bank, and the image keeps its settings in the \
                     second of two";
        let next = "nothing was changed: set the chip's option DBANK, as with STM32CubeProgrammer";
        Err(Refusal::new(cause, next))
    }

    /// Switches the drive off, and stops both it and the watchdogs with the core.
    pub fn drive_off(&mut self) -> Result<()> {
        for (address, bits) in [self.chip.rests, self.chip.stops] {
            let stops = self.word(address)?;
            self.set_word(address, stops | bits)?;
        }
        let (address, bit) = self.chip.drives;
        let drives = self.word(address)?;
        self.set_word(address, drives & !bit)
    }

    pub fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<()> {
        let memory = self.interface.memory_interface(&self.memory);
        let read = memory.and_then(|mut memory| {
            if !address.is_multiple_of(4) || !bytes.len().is_multiple_of(4) {
                return memory.read(address.into(), bytes);
            }
            let mut words = vec![0; bytes.len() / 4];
            memory.read_32(address.into(), &mut words)?;
            for (place, word) in bytes.chunks_exact_mut(4).zip(words) {
                place.copy_from_slice(&word.to_le_bytes());
            }
            Ok(())
        });
        read.map_err(|error| self.no_answer(&error))
    }

    pub fn word(&mut self, address: u32) -> Result<u32> {
        let mut bytes = [0; 4];
        self.read(address, &mut bytes)?;
        Ok(u32::from_le_bytes(bytes))
    }

    pub fn set_word(&mut self, address: u32, word: u32) -> Result<()> {
        let memory = self.interface.memory_interface(&self.memory);
        let written = memory.and_then(|mut memory| memory.write_word_32(address.into(), word));
        written.map_err(|error| self.no_answer(&error))
    }

    fn no_answer(&self, error: &ArmError) -> Refusal {
        let (probe, why) = (&self.probe, causes(error));
        let cause = format!("the chip on the probe {probe} does not answer: {why}");
        Refusal::new(cause, WIRES)
    }

    /// Attaches the debugger; the core stops briefly.
    pub fn control(self) -> Result<Session> {
        let probe: Probe = self.interface.close();
        let session = probe.attach(self.chip.name, Permissions::default());
        session.map_err(|error| {
            let (probe, why) = (&self.probe, causes(&error));
            let cause = format!("the core does not respond to the probe {probe}: {why}");
            Refusal::new(cause, WIRES)
        })
    }
}

pub(super) fn causes(error: &dyn std::error::Error) -> String {
    let mut message = error.to_string();
    let mut source = error.source();
    while let Some(error) = source {
        message += &format!(": {error}");
        source = error.source();
    }
    message
}

fn name(info: &DebugProbeInfo) -> String {
    let serial = info.serial_number.iter().map(|serial| format!(":{serial}"));
    let serial: String = serial.collect();
    format!("{:04x}:{:04x}{serial}", info.vendor_id, info.product_id)
}

fn find(requested: Option<&str>) -> Result<DebugProbeInfo> {
    let lister = Lister::new();
    let all = || lister.list_all();
    let names = |probes: &[DebugProbeInfo]| {
        let names: Vec<String> = probes.iter().map(name).collect();
        names.join(", ")
    };
    let probes = match requested {
        None => all(),
        Some(requested) => {
            let selector: DebugProbeSelector = requested.parse().map_err(|_| {
                let accepted = "VID:PID or VID:PID:SERIAL, such as 0483:3748";
                let next = "name a probe as kband flash lists them";
                Refusal::value("--probe", requested, accepted, next)
            })?;
            let probes = lister.list(Some(&selector));
            let present = if probes.is_empty() { all() } else { Vec::new() };
            if !present.is_empty() {
                let next = "name one that is there";
                return Err(Refusal::value("--probe", requested, names(&present), next));
            }
            probes
        }
    };
    let (cause, next): (String, String) = match &probes[..] {
        [info] => return Ok(info.clone()),
        [] => (
            "no debug probe is there".into(),
            "plug in an ST-Link, J-Link or CMSIS-DAP probe (on Linux with its udev rule: \
             https://probe.rs/docs/getting-started/probe-setup)"
                .into(),
        ),
        [info, ..] => (
            format!("several debug probes are there: {}", names(&probes)),
            format!("name one, such as --probe {}", name(info)),
        ),
    };
    Err(Refusal::new(cause, next))
}
