//! Requests for an update, and the meaning of a board's refusals.

use kband_control::wire::{MAX_UPDATES_PER_START, UpdateAnswer, UpdateRefusal, UpdateRequest};
use kband_scene::refusal::Refusal;

use crate::Link;
use crate::link::{RIGHT_PIN, reset};

impl Link {
    /// Sends a request for an update; an error states why the board refused it.
    pub fn command_update(&mut self, request: &UpdateRequest<'_>) -> Result<(), Refusal> {
        self.updated(request, |answer| match answer {
            UpdateAnswer::Done => Ok(()),
            other => Err(other),
        })
    }

    /// Begins an update; returns whether the board's loader receives the image.
    pub fn begin_update(&mut self, request: &UpdateRequest<'_>) -> Result<bool, Refusal> {
        self.updated(request, |answer| match answer {
            UpdateAnswer::Done => Ok(false),
            UpdateAnswer::Loader => Ok(true),
            other => Err(other),
        })
    }

    /// Sends bytes of an image from `offset` on; returns the number that the board has received.
    pub fn send_image(&mut self, offset: u32, bytes: &[u8]) -> Result<u32, Refusal> {
        let request = UpdateRequest::Bytes { offset, bytes };
        self.updated(&request, |answer| match answer {
            UpdateAnswer::Done => Ok(offset + bytes.len() as u32),
            UpdateAnswer::Refused(UpdateRefusal::Order(has)) => Ok(has),
            other => Err(other),
        })
    }

    /// Name of the board, and whether its image is on trial; refuses a board without a slot.
    pub fn update_state(&mut self) -> Result<(String, bool), Refusal> {
        self.updated(&UpdateRequest::State, |answer| match answer {
            UpdateAnswer::State { size: 0, .. } => {
                Err(UpdateAnswer::Refused(UpdateRefusal::NoSlot))
            }
            UpdateAnswer::State {
                board, on_trial, ..
            } => Ok((board.to_owned(), on_trial)),
            other => Err(other),
        })
    }

    fn updated<T>(
        &mut self,
        request: &UpdateRequest<'_>,
        look: impl FnOnce(UpdateAnswer<'_>) -> Result<T, UpdateAnswer<'_>>,
    ) -> Result<T, Refusal> {
        let name = self.name().to_owned();
        self.request_update(request, |answer| {
            look(answer).map_err(|other| match other {
                UpdateAnswer::Refused(why) => refusal(&name, why),
                UpdateAnswer::Loader => {
                    let cause = format!("{name} has no program: its loader waits for an image");
                    Refusal::new(cause, "kband update IMAGE --key FILE")
                }
                _ => reset(format!(
                    "{name} sent an unexpected answer during the update"
                )),
            })
        })?
    }
}

fn refusal(name: &str, why: UpdateRefusal) -> Refusal {
    let cause = match why {
        UpdateRefusal::Running => "is running its drive, and is updated at rest only",
        UpdateRefusal::ReadOnly => {
            "has a read-only link: a PIN locks it, or its strap, PC1, is wired to ground"
        }
        UpdateRefusal::WrongPin => "was locked with another PIN",
        UpdateRefusal::Wait(_) => "was given five wrong PINs",
        UpdateRefusal::NotInControl => "is controlled by its fieldbus",
        UpdateRefusal::NoSlot => "has no slot for an update",
        UpdateRefusal::NoKey => "has no key for updates",
        UpdateRefusal::HasKey => "has another key, and no PIN that protects it",
        UpdateRefusal::Length => "refuses the length of the key, the image or the signature",
        UpdateRefusal::OtherBoard => "is another board than the image's",
        UpdateRefusal::Order(has) => &format!("has {has} bytes of the image, and needs the next"),
        UpdateRefusal::Signature => {
            "has another key than the image's signature, or the image changed on the line"
        }
        UpdateRefusal::OnTrial => "runs an image on trial",
        UpdateRefusal::SupplyLow => {
            "has a supply of 3.3 V that is too low, or was within the last 0.1 s"
        }
        UpdateRefusal::Store => "could not write its flash, or has no saved settings",
        UpdateRefusal::TooOften => &format!(
            "was given {MAX_UPDATES_PER_START} updates since its start; each wears its flash"
        ),
    };
    let next = match why {
        UpdateRefusal::Running => "withdraw the enable input first",
        UpdateRefusal::ReadOnly => "give --pin PIN, or open the strap",
        UpdateRefusal::WrongPin => RIGHT_PIN,
        UpdateRefusal::Wait(seconds) => &format!("wait for {seconds} s, then give the right PIN"),
        UpdateRefusal::NotInControl => {
            "with the drive at rest: kband settings set bus 0 --save; afterwards set it again"
        }
        UpdateRefusal::NoSlot => "write the image through a debug probe: kband flash",
        UpdateRefusal::NoKey => "give it one: kband update --set-key FILE.pub",
        UpdateRefusal::HasKey => {
            "kband lock PIN first, then kband update --set-key FILE.pub --pin PIN"
        }
        UpdateRefusal::Length => "build the image anew: cargo feeder",
        UpdateRefusal::OtherBoard => {
            "build the image of this board; kband identify names the board"
        }
        UpdateRefusal::Order(_) => "start the update again",
        UpdateRefusal::Signature => {
            "start the update again, with the --key whose .pub the board has"
        }
        UpdateRefusal::OnTrial => {
            "wait for a minute: without a confirmation the previous image returns"
        }
        UpdateRefusal::SupplyLow => "check the supply, then start again",
        UpdateRefusal::Store => "kband settings save, then start again",
        UpdateRefusal::TooOften => "switch the board off and on, then start again",
    };
    Refusal::new(format!("{name} {cause}"), next)
}
