//! The registers of a feeder drive on Modbus, and the server that answers for them.
//!
//! [`Server::answer`] takes a request without checksum and header: unit, function and data. The
//! transports wrap it: [`rtu`] for a serial line, [`tcp`] for a network. One table, [`registers`],
//! defines the meaning of each register and generates the manual's page.
//!
//! The server contains no drive. It reads and sets one through [`Machine`]. The drive takes the
//! commands to run and to acknowledge from [`Server::take_command`].
//!
//! ```
//! use kband_bus::{Answer, Server, rtu};
//! # use kband_bus::{Exception, Machine, Snapshot};
//! # use kband_control::{Settings, Target, wire::Record};
//! # struct TestDrive;
//! # impl Machine for TestDrive {
//! #     fn snapshot(&self) -> Snapshot<'_> { Snapshot::default() }
//! #     fn settings(&self) -> Settings { Settings::default() }
//! #     fn event(&self, _: u32) -> Option<Record> { None }
//! #     fn set_target(&mut self, _: Target) -> Result<(), Exception> { Ok(()) }
//! #     fn set_settings(&mut self, _: &Settings) -> Result<(), Exception> { Ok(()) }
//! #     fn save(&mut self) -> Result<(), Exception> { Ok(()) }
//! # }
//! // Unit 17 reads the state, register 5.
//! let request = [17, 3, 0, 5, 0, 1, 0x96, 0x9b];
//! let mut server = Server::default();
//! let mut answer = Answer::new();
//! assert!(rtu::answer(&mut server, 17, &request, &mut TestDrive, &mut answer));
//! assert_eq!(answer[..5], [17, 3, 2, 0, 0]);
//! ```
#![no_std]
#![deny(unsafe_code)]

#[cfg(test)]
extern crate std;

mod identification;
mod machine;
mod protocol;
pub mod registers;
pub mod rtu;
mod server;
mod target;
pub mod tcp;
mod write;

pub use machine::{Authority, Machine, SaveProgress, Snapshot};
pub use protocol::{Answer, Counters, Exception, MAX_ADU_BYTES};
pub use server::Server;
