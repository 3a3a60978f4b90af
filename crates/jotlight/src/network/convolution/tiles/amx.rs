//! The instructions of AMX for bfloat16, on Linux.
//!
//! This module holds the only `unsafe` code of the crate. Decision 52 reviews it. The functions of
//! the compiler for these instructions are not stable, so they are written in assembly.
#![allow(unsafe_code)]

use std::arch::asm;
use std::arch::x86_64::{__cpuid, __cpuid_count};
use std::cell::Cell;
use std::marker::PhantomData;
use std::sync::atomic::{AtomicU8, Ordering};

use super::{Line, SIDE, TileShape, TileUnit};
use crate::cpu;

/// The tiles of the processor, in the current thread.
///
/// While it exists, the tiles have its shape. They are released when it is dropped.
pub(super) struct Amx {
    shape: TileShape,
    /// The tiles belong to the thread, so an instance must not move to another one.
    thread: PhantomData<*const ()>,
}

thread_local! {
    /// Whether the tiles of the thread have a shape. Another shape would change what loads read.
    static IS_CONFIGURED: Cell<bool> = const { Cell::new(false) };
}

/// Whether this process may use AMX: [`UNKNOWN`] before the first question.
static STATE: AtomicU8 = AtomicU8::new(UNKNOWN);
const UNKNOWN: u8 = 0;
const AVAILABLE: u8 = 1;
const MISSING: u8 = 2;

/// The leaf of CPUID with the bits of AMX, and these bits of EDX.
const FEATURES: u32 = 7;
const AMX_BF16: u32 = 1 << 22;
const AMX_TILE: u32 = 1 << 24;
/// The system call `arch_prctl`, its request for a state of the processor, and that of the tiles.
const ARCH_PRCTL: isize = 158;
const ARCH_REQ_XCOMP_PERM: usize = 0x1023;
const XTILEDATA: usize = 18;

/// The description of all tiles that `ldtilecfg` loads.
#[repr(C, align(64))]
struct TileConfig {
    palette: u8,
    start_row: u8,
    reserved: [u8; 14],
    bytes_per_row: [u16; 16],
    rows: [u8; 16],
}

impl TileConfig {
    fn new(shape: TileShape) -> Self {
        let (mut bytes_per_row, mut rows) = ([0; 16], [0; 16]);
        for tile in 0..8 {
            let (height, width) = match tile {
                0..=3 => (shape.outputs, SIDE),
                4..=5 => (shape.outputs, shape.pairs),
                _ => (shape.pairs, SIDE),
            };
            bytes_per_row[tile] = 4 * width as u16;
            rows[tile] = height as u8;
        }
        Self {
            palette: 1,
            start_row: 0,
            reserved: [0; 14],
            bytes_per_row,
            rows,
        }
    }
}

impl Amx {
    /// Return whether the processor has AMX for bfloat16, the system permits it, and the fastest
    /// instruction set is the current one.
    pub fn is_available() -> bool {
        if cpu::v4().is_none() {
            return false;
        }
        let mut state = STATE.load(Ordering::Relaxed);
        if state == UNKNOWN {
            // Two threads may both ask. The answers are the same.
            let is_available = has_amx() && request_tiles();
            state = if is_available { AVAILABLE } else { MISSING };
            STATE.store(state, Ordering::Relaxed);
        }
        state == AVAILABLE
    }
}

/// Return whether the processor has the instructions.
fn has_amx() -> bool {
    // SAFETY: every processor of x86-64 has the instruction, and each leaf that is at most the
    // largest one. Newer compilers know that, and do not ask for `unsafe`.
    #[allow(unused_unsafe)]
    let features = unsafe {
        if __cpuid(0).eax < FEATURES {
            return false;
        }
        __cpuid_count(FEATURES, 0).edx
    };
    features & (AMX_BF16 | AMX_TILE) == AMX_BF16 | AMX_TILE
}

/// Ask the system for the permission to use tiles, in all threads of the process. Return whether it
/// grants it.
///
/// Linux saves tiles since version 5.16. Older versions return an error.
fn request_tiles() -> bool {
    let mut result = ARCH_PRCTL;
    // SAFETY: this system call takes two numbers and does not access memory of the process. It
    // changes the registers that are listed here, and no others.
    unsafe {
        asm!(
            "syscall",
            inlateout("rax") result,
            in("rdi") ARCH_REQ_XCOMP_PERM,
            in("rsi") XTILEDATA,
            lateout("rcx") _,
            lateout("r11") _,
            options(nostack),
        );
    }
    result == 0
}

impl TileUnit for Amx {
    /// Return tiles of a shape.
    ///
    /// # Panics
    /// If the processor has no tiles, if the tiles of the thread are in use, or for an invalid shape.
    fn configured(shape: TileShape) -> Self {
        assert!(STATE.load(Ordering::Relaxed) == AVAILABLE, "AMX");
        assert!(!IS_CONFIGURED.replace(true), "one user of the tiles");
        let valid = 1..=SIDE;
        assert!(valid.contains(&shape.outputs) && valid.contains(&shape.pairs));
        let config = TileConfig::new(shape);
        // SAFETY: the process may use the tiles, which was checked above. The instruction reads the
        // 64 bytes of the configuration, whose numbers are valid.
        unsafe {
            asm!(
                "ldtilecfg [{}]",
                in(reg) &raw const config,
                out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                options(nostack, readonly, preserves_flags),
            );
        }
        Self {
            shape,
            thread: PhantomData,
        }
    }

    #[inline(always)]
    fn load_filters<const TILE: usize>(&mut self, lines: &[Line]) {
        const {
            assert!(TILE / 2 == 2);
        }
        assert!(lines.len() >= self.shape.outputs);
        // SAFETY: the tile is configured, because `self` exists. It reads at most 64 bytes of each of
        // its rows, which are lines.
        unsafe {
            asm!(
                "tileloadd tmm{tile}, [{lines} + {stride}]",
                tile = const TILE,
                lines = in(reg) lines.as_ptr(),
                stride = in(reg) size_of::<Line>(),
                options(nostack, readonly, preserves_flags),
            );
        }
    }

    #[inline(always)]
    fn load_planes<const TILE: usize>(&mut self, source: &[u32], stride: usize) {
        const {
            assert!(TILE / 2 == 3);
        }
        assert!(source.len() >= (self.shape.pairs - 1) * stride + SIDE);
        // SAFETY: the tile is configured, because `self` exists. It reads 64 bytes of each of its
        // rows, which lie in the source.
        unsafe {
            asm!(
                "tileloadd tmm{tile}, [{source} + {stride}]",
                tile = const TILE,
                source = in(reg) source.as_ptr(),
                stride = in(reg) 4 * stride,
                options(nostack, readonly, preserves_flags),
            );
        }
    }

    #[inline(always)]
    fn zero<const TILE: usize>(&mut self) {
        // SAFETY: the tile is configured, because `self` exists.
        unsafe {
            asm!(
                "tilezero tmm{tile}",
                tile = const TILE,
                options(nostack, nomem, preserves_flags),
            );
        }
    }

    #[inline(always)]
    fn multiply<const SUMS: usize, const FILTERS: usize, const PLANES: usize>(&mut self) {
        const {
            assert!(SUMS < 4 && FILTERS / 2 == 2 && PLANES / 2 == 3);
        }
        // SAFETY: the tiles are configured, because `self` exists. Their shapes fit each other, because
        // their numbers are those of sums, filters, and planes.
        unsafe {
            asm!(
                "tdpbf16ps tmm{sums}, tmm{filters}, tmm{planes}",
                sums = const SUMS,
                filters = const FILTERS,
                planes = const PLANES,
                options(nostack, nomem, preserves_flags),
            );
        }
    }

    #[inline(always)]
    fn store<const TILE: usize>(&self, out: &mut [f32], stride: usize) {
        const {
            assert!(TILE < 4);
        }
        assert!(out.len() >= (self.shape.outputs - 1) * stride + SIDE);
        // SAFETY: the tile is configured, because `self` exists. It writes 64 bytes of each of its
        // rows, which lie in `out`.
        unsafe {
            asm!(
                "tilestored [{out} + {stride}], tmm{tile}",
                tile = const TILE,
                out = in(reg) out.as_mut_ptr(),
                stride = in(reg) 4 * stride,
                options(nostack, preserves_flags),
            );
        }
    }
}

impl Drop for Amx {
    fn drop(&mut self) {
        // SAFETY: the process may use the tiles, because `self` exists. No other instance does in
        // this thread.
        unsafe {
            asm!(
                "tilerelease",
                out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                options(nostack, nomem, preserves_flags),
            );
        }
        IS_CONFIGURED.set(false);
    }
}
