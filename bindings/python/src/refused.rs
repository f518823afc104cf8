//! Refused values and scenes as `ValueError`.

use kband::feeder::OutOfRange;
use kband_scene::refusal::Refusal;
use pyo3::PyErr;
use pyo3::exceptions::PyValueError;

#[derive(Clone, Debug)]
pub enum Refused {
    Value(OutOfRange, Option<usize>),
    Scene(Refusal),
}

impl Refused {
    /// Makes the refusal of an element of an array.
    pub fn element(index: usize) -> impl Fn(OutOfRange) -> Self {
        move |refused| Self::Value(refused, Some(index))
    }

    /// As an exception; `shape` is that of the arrays.
    pub fn exception(self, shape: &[usize]) -> PyErr {
        match self {
            Self::Scene(refusal) => PyValueError::new_err(message(&refusal)),
            Self::Value(refused, index) => {
                let name = match refused.parameter {
                    "velocity" => "speed",
                    other => other,
                };
                let place = index.map_or(String::new(), |index| place(index, shape));
                let (value, accepted) = (refused.value, refused.accepted);
                let refusal = format!("{name}{place} = {value:?} is refused");
                PyValueError::new_err(format!("{refusal}; accepted: {accepted}"))
            }
        }
    }
}

/// Text of a refusal, without the word of the command line before it.
pub fn message(refusal: &Refusal) -> String {
    let message = refusal.to_string();
    message.trim_start_matches("error: ").to_string()
}

/// The index of an element in row-major order, as `[1, 2]`; empty for one value.
fn place(mut index: usize, shape: &[usize]) -> String {
    if shape.is_empty() {
        return String::new();
    }
    let mut digits = Vec::new();
    for length in shape.iter().rev() {
        digits.push((index % length.max(&1)).to_string());
        index /= length.max(&1);
    }
    digits.reverse();
    format!("[{}]", digits.join(", "))
}

impl From<OutOfRange> for Refused {
    fn from(refused: OutOfRange) -> Self {
        Self::Value(refused, None)
    }
}

impl From<Refusal> for Refused {
    fn from(refusal: Refusal) -> Self {
        Self::Scene(refusal)
    }
}

impl From<Refused> for PyErr {
    fn from(refused: Refused) -> Self {
        refused.exception(&[])
    }
}
