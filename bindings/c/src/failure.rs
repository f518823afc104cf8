//! Codes of failures, their texts, and the boundary that no panic crosses.

use std::cell::RefCell;
use std::ffi::{CStr, c_char};
use std::fmt;
use std::mem::MaybeUninit;
use std::panic::{AssertUnwindSafe, catch_unwind};

use kband::feeder::OutOfRange;
use kband_scene::refusal::Refusal;

/// What came of a call. Numbers never change.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Code {
    /// Done.
    Ok = 0,
    /// A pointer is null.
    Null = 1,
    /// A value is out of range.
    OutOfRange = 2,
    /// The text is no scene.
    Scene = 3,
    /// There is no such band or plan.
    None = 4,
    /// An error of kband: the handle of this call is only good to be freed.
    Panic = 5,
}

/// Text of a code; of another number "no code of kband".
#[unsafe(no_mangle)]
pub extern "C" fn kband_code_text(code: i32) -> *const c_char {
    // By number.
    const TEXTS: [&CStr; 6] = [
        c"done",
        c"a pointer is null",
        c"a value is out of range",
        c"the text is no scene",
        c"there is no such band or plan",
        c"an error of kband; report it",
    ];
    let text = usize::try_from(code).ok().and_then(|code| TEXTS.get(code));
    text.unwrap_or(&c"no code of kband").as_ptr()
}

thread_local! {
    /// Cause of the last failed call of this thread.
    static MESSAGE: RefCell<String> = const { RefCell::new(String::new()) };
}

/// A failed call; its message is kept for the thread.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Failure(Code);

impl Failure {
    pub(crate) fn new(code: Code, message: fmt::Arguments<'_>) -> Self {
        MESSAGE.set(message.to_string());
        Self(code)
    }

    /// A refused element of an array.
    pub(crate) fn element(refused: OutOfRange, index: usize) -> Self {
        let name = match refused.parameter {
            "velocity" => "speed",
            other => other,
        };
        let (value, accepted) = (refused.value, refused.accepted);
        let message = format_args!("{name}[{index}] = {value} is refused; accepted: {accepted}");
        Self::new(Code::OutOfRange, message)
    }
}

impl From<OutOfRange> for Failure {
    fn from(refused: OutOfRange) -> Self {
        let (name, value, accepted) = (refused.parameter, refused.value, refused.accepted);
        let message = format_args!("{name} = {value} is refused; accepted: {accepted}");
        Self::new(Code::OutOfRange, message)
    }
}

impl From<Refusal> for Failure {
    fn from(refusal: Refusal) -> Self {
        Self::new(Code::Scene, format_args!("{refusal}"))
    }
}

/// Runs the work of a call. Failures and panics become codes.
pub(crate) fn call(work: impl FnOnce() -> Result<(), Failure>) -> Code {
    match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(())) => Code::Ok,
        Ok(Err(Failure(code))) => code,
        Err(_) => {
            Failure::new(Code::Panic, format_args!("an error of kband; report it"));
            Code::Panic
        }
    }
}

type Place<'a, T> = Option<&'a mut MaybeUninit<T>>;

/// Writes to where a pointer refers to; an error for a null pointer.
pub(crate) fn put<T>(place: Place<'_, T>, name: &str, value: T) -> Result<(), Failure> {
    require(place, name)?.write(value);
    Ok(())
}

/// The object that a pointer refers to; an error for a null pointer.
pub(crate) fn require<T>(pointer: Option<T>, name: &str) -> Result<T, Failure> {
    pointer.ok_or_else(|| Failure::new(Code::Null, format_args!("{name} is null")))
}

/// Copies why the last failed call of this thread failed, with a zero at the end, into `size`
/// bytes; it is cut to fit. Returns its length without the zero; 0 where none failed.
///
/// # Safety
/// `buffer` has `size` bytes, or is null with `size` 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn kband_error(buffer: *mut c_char, size: usize) -> usize {
    MESSAGE.with_borrow(|message| {
        if !buffer.is_null() && size > 0 {
            let count = message.len().min(size - 1);
            // SAFETY: the caller guarantees the buffer, which does not overlap the message.
            unsafe {
                buffer.copy_from_nonoverlapping(message.as_ptr().cast(), count);
                buffer.add(count).write(0);
            }
        }
        message.len()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_a_code() {
        assert_eq!(call(|| panic!("an error")), Code::Panic);
        assert_eq!(call(|| Ok(())), Code::Ok);
        // SAFETY: null with size 0.
        let length = unsafe { kband_error(std::ptr::null_mut(), 0) };
        assert_eq!(length, "an error of kband; report it".len());
    }
}
