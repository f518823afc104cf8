//! Keys for the signatures of updates: Ed25519 (RFC 8032), each in a file of one line.

use std::fmt::Write as _;
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use salty::{Keypair, Sha512};

use crate::file::{self, Destination};
use crate::refusal::{Refusal, Result};

/// First word in the file of a secret key.
const SECRET: &str = "kband-secret-key";
const PUBLIC: &str = "kband-public-key";

/// Makes a key pair. The secret key is in a new file readable only by its owner, the public key in
/// a file with the ending `.pub`. Returns the path of the public key.
pub fn create(path: &Path) -> Result<PathBuf> {
    let mut seed = [0; 32];
    getrandom::fill(&mut seed).map_err(|error| {
        let cause = format!("the system gives no random numbers: {error}");
        Refusal::new(cause, "make the key on another machine")
    })?;
    let mut name = path.as_os_str().to_owned();
    name.push(".pub");
    let public = PathBuf::from(name);
    for path in [path, &public] {
        Destination::check(path)?;
        if path.exists() {
            let cause = format!("{} is there already", path.display());
            let next = "give another name: a key is never overwritten";
            return Err(Refusal::new(cause, next));
        }
    }
    let pair = Keypair::from(&seed);
    write(&public, PUBLIC, pair.public.as_bytes(), 0o644)?;
    write(path, SECRET, &seed, 0o600).inspect_err(|_| _ = std::fs::remove_file(&public))?;
    Ok(public)
}

/// Signed data of an image for the board with this name: SHA-512 of image and name.
pub fn sum(image: &[u8], board: &str) -> [u8; 64] {
    let mut sum = Sha512::new();
    sum.update(image);
    sum.update(board.as_bytes());
    sum.finalize()
}

/// Signature of a sum by the secret key in a file.
pub fn sign(key: &Path, sum: &[u8; 64]) -> Result<[u8; 64]> {
    Ok(Keypair::from(&read(key, SECRET)?).sign(sum).to_bytes())
}

pub fn read_public(path: &Path) -> Result<[u8; 32]> {
    read(path, PUBLIC)
}

fn read(path: &Path, kind: &str) -> Result<[u8; 32]> {
    let text = file::read_text(path)?;
    let key = text.trim().strip_prefix(kind).map(str::trim_start);
    key.and_then(bytes).ok_or_else(|| {
        Refusal::new(
            format!("{} holds no {kind}", path.display()),
            match kind {
                SECRET => "give the file that kband update --new-key made, without .pub",
                _ => "give the file with .pub that kband update --new-key made",
            },
        )
        .accepting(format!("{kind} and 64 hexadecimal digits"))
    })
}

/// Key from 64 hexadecimal digits.
fn bytes(digits: &str) -> Option<[u8; 32]> {
    let digits = digits.chars().map(|digit| Some(digit.to_digit(16)? as u8));
    let digits: Vec<u8> = digits.collect::<Option<_>>()?;
    let (pairs, []) = digits.as_chunks::<2>() else {
        return None;
    };
    let key: Vec<u8> = pairs.iter().map(|[high, low]| high << 4 | low).collect();
    key.try_into().ok()
}

/// Writes a key to a new file with these permissions; a failed attempt leaves no file.
fn write(path: &Path, kind: &str, key: &[u8; 32], mode: u32) -> Result<()> {
    let mut text = format!("{kind} ");
    for byte in key {
        // Writing to a String cannot fail.
        let _ = write!(text, "{byte:02x}");
    }
    text.push('\n');
    let mut options = File::options();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, mode);
    #[cfg(not(unix))]
    let _ = mode;
    let refuse = |error| Refusal::file(path, &error, file::NEXT_WRITABLE);
    let mut file = options.open(path).map_err(refuse)?;
    let written = file.write_all(text.as_bytes());
    written.and_then(|()| file.sync_all()).map_err(|error| {
        let _ = std::fs::remove_file(path);
        refuse(error)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signature_is_that_of_an_independent_program() {
        let folder = tempfile::tempdir().unwrap();
        let (secret, public) = (folder.path().join("key"), folder.path().join("key.pub"));
        // RFC 8032, 7.1, test 1; signature by OpenSSL 3.
        let key = "9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60";
        std::fs::write(&secret, format!("kband-secret-key {key}\n")).unwrap();
        let signature = sign(&secret, &sum(&[0x5a; 1024], "stm32f405rg")).unwrap();
        let hex: String = signature.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(hex, SIGNATURE);
        let key = "d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a";
        std::fs::write(&public, format!("kband-public-key {key}\n")).unwrap();
        let pair = Keypair::from(&read(&secret, SECRET).unwrap());
        assert_eq!(&read_public(&public).unwrap(), pair.public.as_bytes());
    }

    const SIGNATURE: &str = "0429f8dd4fbde3c5c3989a1495520a4e447372ec55fd0d2c2f911895c82292d5\
        e3f7dbdc6787f3cb0a6dfb179fb1f09c67243fc689d456938c5ab4758995c600";

    #[test]
    fn a_new_key_signs_and_is_never_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        let public = create(&path).unwrap();
        assert_eq!(public, folder.path().join("key.pub"));
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            assert_eq!(path.metadata().unwrap().permissions().mode() & 0o777, 0o600);
        }
        // An output of this process is no input of it, but its copies are.
        let copies = [(&path, "copy"), (&public, "copy.pub")].map(|(file, name)| {
            let copy = folder.path().join(name);
            std::fs::copy(file, &copy).unwrap();
            copy
        });
        let signature = sign(&copies[0], &sum(b"image", "board")).unwrap();
        let key = salty::PublicKey::try_from(&read_public(&copies[1]).unwrap()).unwrap();
        let mut both = Sha512::new();
        both.update(b"imageboard");
        let signature = salty::Signature::from(&signature);
        assert!(key.verify(&both.finalize(), &signature).is_ok());
        let before = std::fs::read(&path).unwrap();
        assert!(create(&path).is_err());
        assert_eq!(std::fs::read(&path).unwrap(), before);
        std::fs::remove_file(&path).unwrap();
        assert!(create(&path).is_err() && !path.exists());
        let other = folder.path().join("other");
        create(&other).unwrap();
        assert_ne!(std::fs::read(&other).unwrap(), before);
    }

    /// tests/wrong_inputs.txt has damaged keys.
    #[test]
    fn a_public_key_does_not_sign() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key.pub");
        std::fs::write(&path, format!("kband-public-key {}", "00".repeat(32))).unwrap();
        let message = sign(&path, &[0; 64]).unwrap_err().to_string();
        for part in ["holds no kband-secret-key", "64 hexa", "without .pub"] {
            assert!(message.contains(part), "{message}");
        }
    }
}
