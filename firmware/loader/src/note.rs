//! Note between program and loader, in RAM that a reset does not change.

/// Marks of a note, 128 arbitrary bits each: RAM after power-on is arbitrary.
const REQUEST: [u32; 4] = [0x3d1c_8a57, 0xb604_e92f, 0x58f7_13cb, 0x9e2a_7d40];
const STARTED: [u32; 4] = [0xc2e5_6b18, 0x47d9_30a4, 0xa10f_bc73, 0x6b84_f52e];

/// The note.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Note {
    mark: [u32; 4],
    key: [u8; 32],
}

impl Note {
    /// No note.
    pub const NONE: Self = Self {
        mark: [0; 4],
        key: [0; 32],
    };

    /// From the loader: it started the program after a wait, which is no fault.
    pub const STARTED: Self = Self {
        mark: STARTED,
        ..Self::NONE
    };

    /// From the program: the loader must wait for an image with a signature for this public key.
    pub const fn request(key: [u8; 32]) -> Self {
        Self { mark: REQUEST, key }
    }

    /// The public key of a request.
    pub fn key(&self) -> Option<[u8; 32]> {
        (self.mark == REQUEST).then_some(self.key)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_request_holds_a_key() {
        assert_eq!(Note::request([7; 32]).key(), Some([7; 32]));
        assert_eq!(Note::STARTED.key(), None);
        for word in 0..4 {
            let mut note = Note::request([7; 32]);
            note.mark[word] ^= 1;
            assert_eq!(note.key(), None);
        }
    }
}
