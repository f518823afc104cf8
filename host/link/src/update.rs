//! Requests for an update, and the meaning of a board's refusals.

use kband_control::wire::{MAX_UPDATES_PER_START, UpdateAnswer, UpdateRefusal, UpdateRequest};
use kband_scene::refusal::Refusal;

use crate::Link;

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

    /// Sends bytes of an image from `offset` on. Returns the number of bytes that the board has
    /// received.
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
                UpdateAnswer::Loader => Refusal::new(
                    format!("{name} has no program: its loader waits for an image"),
                    "kband update IMAGE --key FILE",
                ),
                _ => Refusal::new(
                    format!("{name} sent an unexpected answer during the update"),
                    "reset the board",
                ),
            })
        })?
    }
}

fn refusal(name: &str, why: UpdateRefusal) -> Refusal {
    let (cause, next): (String, String) = match why {
        UpdateRefusal::Running => (
            "is running its drive, and is updated at rest only".into(),
            "withdraw the enable input first".into(),
        ),
        UpdateRefusal::ReadOnly => (
            "has a read-only link: a PIN locks it, or its strap, PC1, is wired to ground".into(),
            "give --pin PIN, or open the strap".into(),
        ),
        UpdateRefusal::WrongPin => (
            "was locked with another PIN".into(),
            "give the right PIN; after five wrong ones the board waits for a minute".into(),
        ),
        UpdateRefusal::Wait(seconds) => (
            "was given five wrong PINs".into(),
            format!("wait for {seconds} s, then give the right PIN"),
        ),
        UpdateRefusal::NotInControl => (
            "is controlled by its fieldbus".into(),
            "with the drive at rest: kband settings set bus 0 --save; afterwards set it again"
                .into(),
        ),
        UpdateRefusal::NoSlot => (
            "has no slot for an update".into(),
            "write the image through a debug probe: kband flash".into(),
        ),
        UpdateRefusal::NoKey => (
            "has no key for updates".into(),
            "give it one: kband update --set-key FILE.pub".into(),
        ),
        UpdateRefusal::HasKey => (
            "has another key, and no PIN that protects it".into(),
            "kband lock PIN first, then kband update --set-key FILE.pub --pin PIN".into(),
        ),
        UpdateRefusal::Length => (
            "refuses the length of the key, the image or the signature".into(),
            "build the image anew: cargo feeder".into(),
        ),
        UpdateRefusal::OtherBoard => (
            "is another board than the image's".into(),
            "build the image of this board; kband identify names the board".into(),
        ),
        UpdateRefusal::Order(has) => (
            format!("has {has} bytes of the image, and needs the next"),
            "start the update again".into(),
        ),
        UpdateRefusal::Signature => (
            "has another key than the image's signature, or the image changed on the line".into(),
            "start the update again, with the --key whose .pub the board has".into(),
        ),
        UpdateRefusal::OnTrial => (
            "runs an image on trial".into(),
            "wait for a minute: without a confirmation the previous image returns".into(),
        ),
        UpdateRefusal::SupplyLow => (
            "has a supply of 3.3 V that is too low, or was within the last 0.1 s".into(),
            "check the supply, then start again".into(),
        ),
        UpdateRefusal::Store => (
            "could not write its flash, or has no saved settings".into(),
            "kband settings save, then start again".into(),
        ),
        UpdateRefusal::TooOften => (
            format!(
                "was given {MAX_UPDATES_PER_START} updates since its start; each wears its flash"
            ),
            "switch the board off and on, then start again".into(),
        ),
    };
    Refusal::new(format!("{name} {cause}"), next)
}
