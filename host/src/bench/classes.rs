//! Instructions per impact by class on the emulated microcontrollers, from the emulator's execution
//! log.

use std::collections::HashMap;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Stdio;

use super::instructions::{MACHINES, emulator, failed, image};

/// Classes of instructions.
pub const CLASSES: [&str; 10] = [
    "integer",
    "multiply",
    "divide",
    "float",
    "float divide, root",
    "float move",
    "load",
    "store",
    "branch",
    "other",
];

/// Instructions per impact of each class, in the order of [`CLASSES`].
#[derive(Clone, Debug, PartialEq)]
pub struct ByClass {
    /// Name of the kernel.
    pub kernel: String,
    /// `m4f` or `m0`.
    pub cpu: &'static str,
    /// Instructions per impact.
    pub instructions: [f64; CLASSES.len()],
}

/// Mean instructions of every kernel on its CPU, over the orbits of the image.
///
/// # Errors
/// Without the image or the emulator, or for a log that cannot be parsed.
pub fn counts() -> Result<Vec<ByClass>, String> {
    let mut all = Vec::new();
    for (_, target, cpu) in MACHINES {
        all.extend(of(cpu, &image(target, "kernel_orbits")?)?);
    }
    Ok(all)
}

/// Mean instructions of the kernels in one image for a CPU, `m4f` or `m0`.
///
/// # Errors
/// See [`counts`].
pub fn of(cpu: &str, image: &Path) -> Result<Vec<ByClass>, String> {
    let (machine, _, cpu) = MACHINES
        .into_iter()
        .find(|(.., name)| *name == cpu)
        .ok_or_else(|| format!("no emulated CPU {cpu}: m4f or m0"))?;
    let mut child = emulator(machine, image)
        .args(["-d", "in_asm,exec,nochain", "-D", "/dev/stdout"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|error| format!("no emulator: {error}"))?;
    let mut log = Log::default();
    let lines = child.stdout.take().map(BufReader::new);
    for line in lines.into_iter().flat_map(|lines| lines.split(b'\n')) {
        let line = line.map_err(|error| format!("the emulator's log: {error}"))?;
        log.line(&String::from_utf8_lossy(&line));
    }
    let output = child
        .wait_with_output()
        .map_err(|error| format!("the emulator: {error}"))?;
    if !output.status.success() {
        return Err(failed(machine, output.status));
    }
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let kernels: Vec<_> = said.lines().filter_map(flown).collect();
    let calls: Vec<&[Counts]> = log
        .calls
        .chunk_by(|a, b| a.0 == b.0)
        .map(|calls| &log.counts[calls[0].1..][..calls.len()])
        .collect();
    if kernels.is_empty() || kernels.len() != calls.len() {
        return Err(format!(
            "{} kernels in the emulator's log, {} in what the image says",
            calls.len(),
            kernels.len()
        ));
    }
    if log
        .counts
        .iter()
        .any(|counts| counts.iter().sum::<u64>() == 0)
    {
        return Err("an emulator whose log names no instructions".into());
    }
    let counted = kernels.into_iter().zip(calls);
    Ok(counted
        .map(|((kernel, impacts), calls)| {
            // The first of each two calls brings the orbit to its final regime.
            let settled = calls.iter().skip(1).step_by(2);
            let all = impacts * settled.len() as f64;
            let of = |class| settled.clone().map(|counts| counts[class]).sum::<u64>() as f64 / all;
            ByClass {
                kernel,
                cpu,
                instructions: std::array::from_fn(of),
            }
        })
        .collect())
}

/// `flies KERNEL IMPACTS`: the following calls are of this kernel, with this number of impacts each.
fn flown(line: &str) -> Option<(String, f64)> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let ["flies", kernel, impacts] = words[..] else {
        return None;
    };
    Some((kernel.into(), impacts.parse().ok()?))
}

type Counts = [u64; CLASSES.len()];

/// A basic block: instructions that are executed in sequence.
#[derive(Clone, Debug, Default)]
struct Block {
    counts: Counts,
    begin: u32,
    /// Address after the block.
    end: u32,
}

/// Parser state of a log.
#[derive(Debug, Default)]
struct Log {
    /// Last translated block.
    last: Block,
    /// Blocks by the emulator's address.
    blocks: HashMap<String, Block>,
    /// Last executed block, and whether it counts.
    before: Option<(Block, bool)>,
    /// Return address of the current call.
    returns: Option<u32>,
    /// Start address of each call's function, and the index of its counts.
    calls: Vec<(u32, usize)>,
    counts: Vec<Counts>,
}

impl Log {
    fn line(&mut self, line: &str) {
        if let Some(rest) = line.strip_prefix("Trace ") {
            self.executed(rest);
        } else if line.starts_with("IN: ") {
            self.last = Block::default();
        } else if let Some(rest) = line.strip_prefix("0x") {
            self.translated(rest);
        } else if line.starts_with("Stopped execution") {
            // The block was not executed after all.
            if let (Some((block, true)), Some(counts)) =
                (self.before.take(), self.counts.last_mut())
            {
                for (count, less) in counts.iter_mut().zip(block.counts) {
                    *count -= less;
                }
            }
        }
    }

    /// `ADDRESS:  HALFWORD [HALFWORD]  MNEMONIC OPERANDS`.
    fn translated(&mut self, rest: &str) {
        let Some((address, rest)) = rest.split_once(':') else {
            return;
        };
        let mut words = rest.split_whitespace();
        let halfword = |word: &&str| word.len() == 4 && u16::from_str_radix(word, 16).is_ok();
        let (Ok(address), Some(_)) = (
            u32::from_str_radix(address, 16),
            words.next().filter(halfword),
        ) else {
            return;
        };
        // No mnemonic of four letters is a hexadecimal number.
        let mut size = 2;
        let mut word = words.next();
        if word.as_ref().is_some_and(halfword) {
            size = 4;
            word = words.next();
        }
        if self.last.end == 0 {
            self.last.begin = address;
        }
        self.last.end = address + size;
        self.last.counts[class(word.unwrap_or_default())] += 1;
    }

    /// `CPU: KEPT [../ADDRESS/../..] FUNCTION`.
    fn executed(&mut self, rest: &str) {
        let words: Vec<&str> = rest.split_whitespace().collect();
        let [_, kept, place, ref names @ ..] = words[..] else {
            return;
        };
        let address = place.split('/').nth(1);
        let Some(address) = address.and_then(|at| u32::from_str_radix(at, 16).ok()) else {
            return;
        };
        if self.last.begin == address && self.last.end != 0 {
            self.blocks
                .insert(kept.into(), std::mem::take(&mut self.last));
        }
        let block = self.blocks.get(kept).cloned().unwrap_or_default();
        if self.returns == Some(address) {
            self.returns = None;
        }
        // A function is entered at its first address, the first one in the log.
        let entered = names
            .first()
            .is_some_and(|name| name.contains("kernels3fly"));
        if self.returns.is_none() && entered {
            self.returns = self.before.as_ref().map(|(before, _)| before.end);
            self.calls.push((address, self.counts.len()));
            self.counts.push(Counts::default());
        }
        let counts = self.counts.last_mut().filter(|_| self.returns.is_some());
        let counted = counts.is_some();
        if let Some(counts) = counts {
            for (count, more) in counts.iter_mut().zip(block.counts) {
                *count += more;
            }
        }
        self.before = Some((block, counted));
    }
}

/// Index of an instruction's class in [`CLASSES`].
fn class(mnemonic: &str) -> usize {
    let name = mnemonic.split('.').next().unwrap_or_default();
    let is = |names: &[&str]| names.contains(&name);
    let begins = |with: &[&str]| with.iter().any(|with| name.starts_with(with));
    let class = if begins(&["vdiv", "vsqrt"]) {
        "float divide, root"
    } else if begins(&["vmov", "vmrs", "vmsr"]) {
        "float move"
    } else if begins(&["vldr", "vldm", "vpop", "ldr", "ldm", "ldrex", "pop"]) {
        "load"
    } else if begins(&["vstr", "vstm", "vpush", "str", "stm", "strex", "push"]) {
        "store"
    } else if begins(&["v"]) {
        "float"
    } else if begins(&["udiv", "sdiv"]) {
        "divide"
    } else if begins(&[
        "mul", "mla", "mls", "umull", "umlal", "umaal", "smul", "smla", "smmul", "smml",
    ]) {
        "multiply"
    } else if branches(name) {
        "branch"
    } else if is(&[
        "nop", "bkpt", "svc", "dmb", "dsb", "isb", "cpsid", "cpsie", "mrs", "msr", "wfi", "wfe",
        "sev", "udf", "",
    ]) {
        "other"
    } else {
        "integer"
    };
    CLASSES
        .iter()
        .position(|one| *one == class)
        .unwrap_or_default()
}

/// Whether an instruction branches or makes the next ones conditional.
fn branches(name: &str) -> bool {
    const CONDITIONS: [&str; 17] = [
        "", "eq", "ne", "hs", "cs", "lo", "cc", "mi", "pl", "vs", "vc", "hi", "ls", "ge", "lt",
        "gt", "le",
    ];
    let conditional = |first: &str| {
        name.strip_prefix(first)
            .is_some_and(|condition| CONDITIONS.contains(&condition))
    };
    let then = |rest: &str| rest.bytes().all(|letter| matches!(letter, b't' | b'e'));
    ["b", "bl", "bx", "blx"].into_iter().any(conditional)
        || ["cbz", "cbnz", "tbb", "tbh"].contains(&name)
        || name.strip_prefix("it").is_some_and(then)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_mnemonic_has_its_class() {
        for (class_of, mnemonics) in [
            (
                "integer",
                "adds adc.w bic bics bfi bfc lsls mov movs movw movt sbfx clz cmp it_ mvn.w rsb teq uxth",
            ),
            (
                "multiply",
                "muls mla mls umull smull umlal smlal smmul smmulr mul",
            ),
            ("divide", "udiv sdiv"),
            (
                "float",
                "vadd.f32 vmla.f32 vmls.f32 vcvt.f32.s32 vcmp.f32 vneg.f32 vabs.f32 vnmul.f32",
            ),
            ("float divide, root", "vdiv.f32 vsqrt.f32 vdivmi.f32"),
            ("float move", "vmov vmov.f32 vmovgt.f32 vmrs"),
            ("load", "ldr ldrd ldr.w ldm.w pop vldr vpop ldrb.w"),
            ("store", "str strd stm.w push push.w vstr vpush"),
            (
                "branch",
                "b b.w bl bx blx bpl bpl.w bls blt ble bne cbz cbnz tbb it ite itte itttt bxne",
            ),
            ("other", "nop bkpt svc"),
        ] {
            for mnemonic in mnemonics.split_whitespace() {
                assert_eq!(CLASSES[class(mnemonic)], class_of, "{mnemonic}");
            }
        }
    }

    /// Two calls, the second with a call inside, and a block that is not executed after all.
    #[test]
    fn a_call_counts_what_it_calls_until_it_returns() {
        let text = "IN: main
0x08000100:  f000 f87e  bl       #0x8000200

Trace 0: 0x7f01 [00800400/0000000008000100/00000110/ff020200] main
IN: _ZN7kernels3fly17h0123E
0x08000200:  1840       adds     r0, r0, r1
0x08000202:  f000 f8fd  bl       #0x8000300

Trace 0: 0x7f02 [00800400/0000000008000200/00000110/ff020200] _ZN7kernels3fly17h0123E
IN: more
0x08000300:  4348       muls     r0, r1, r0
0x08000302:  4770       bx       lr

Trace 0: 0x7f03 [00800400/0000000008000300/00000110/ff020200] more
IN: _ZN7kernels3fly17h0123E
0x08000206:  bd80       pop      {r7, pc}

Trace 0: 0x7f04 [00800400/0000000008000206/00000110/ff020200] _ZN7kernels3fly17h0123E
IN: main
0x08000104:  4348       muls     r0, r1, r0

Trace 0: 0x7f05 [00800400/0000000008000104/00000110/ff020200] main
Trace 0: 0x7f01 [00800400/0000000008000100/00000110/ff020200] main
Trace 0: 0x7f02 [00800400/0000000008000200/00000110/ff020200] _ZN7kernels3fly17h0123E
Trace 0: 0x7f04 [00800400/0000000008000206/00000110/ff020200] _ZN7kernels3fly17h0123E
Stopped execution of TB chain before 0x7f04 [0000000008000206]
Trace 0: 0x7f04 [00800400/0000000008000206/00000110/ff020200] _ZN7kernels3fly17h0123E
";
        let mut log = Log::default();
        text.lines().for_each(|line| log.line(line));
        assert_eq!(log.calls, [(0x0800_0200, 0), (0x0800_0200, 1)]);
        let named = |counts: &Counts| -> Vec<(&str, u64)> {
            let named = CLASSES.into_iter().zip(*counts);
            named.filter(|(_, count)| *count > 0).collect()
        };
        assert_eq!(
            named(&log.counts[0]),
            [("integer", 1), ("multiply", 1), ("load", 1), ("branch", 2)]
        );
        assert_eq!(
            named(&log.counts[1]),
            [("integer", 1), ("load", 1), ("branch", 1)]
        );
    }

    #[test]
    fn what_an_image_flies_is_read() {
        assert_eq!(flown("flies hybrid 500"), Some(("hybrid".into(), 500.0)));
        assert_eq!(flown("flies hybrid"), None);
        assert_eq!(flown("hash hybrid 0011"), None);
    }
}
