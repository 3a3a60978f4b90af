//! Instruction sets. Each hot loop is written once and compiled for several instruction sets.
//!
//! The engine selects the fastest instruction set of the processor. Tests may select another one.

use std::sync::atomic::{AtomicU8, Ordering};

use pulp::Scalar;
pub(crate) use pulp::{Simd, WithSimd};

use crate::error::{Error, Result};

/// A level: an instruction set for which the hot loops are compiled. Its variants depend on the
/// processor for which the crate is compiled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Level {
    /// Scalar code: one number at a time.
    Scalar,
    /// x86-64-v3: AVX2 and fused multiply-add, eight numbers of 32 bits at a time.
    #[cfg(target_arch = "x86_64")]
    V3,
    /// x86-64-v4: AVX-512, sixteen numbers of 32 bits at a time.
    #[cfg(target_arch = "x86_64")]
    V4,
    /// Arm's NEON, four numbers of 32 bits at a time.
    #[cfg(target_arch = "aarch64")]
    Neon,
}

/// All levels, from the slowest to the fastest.
const LEVELS: &[Level] = &[
    Level::Scalar,
    #[cfg(target_arch = "x86_64")]
    Level::V3,
    #[cfg(target_arch = "x86_64")]
    Level::V4,
    #[cfg(target_arch = "aarch64")]
    Level::Neon,
];

/// The index in [`LEVELS`] of the current level, or [`UNKNOWN`] before it is detected.
static CURRENT: AtomicU8 = AtomicU8::new(UNKNOWN);
const UNKNOWN: u8 = u8::MAX;

impl Level {
    /// Return the name of the level.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Scalar => "scalar",
            #[cfg(target_arch = "x86_64")]
            Self::V3 => "x86-64-v3",
            #[cfg(target_arch = "x86_64")]
            Self::V4 => "x86-64-v4",
            #[cfg(target_arch = "aarch64")]
            Self::Neon => "neon",
        }
    }

    /// Return the levels that this processor supports, from the slowest to the fastest.
    #[must_use]
    pub fn supported() -> Vec<Self> {
        let mut levels = LEVELS.to_vec();
        levels.retain(|level| level.is_supported());
        levels
    }

    fn is_supported(self) -> bool {
        match self {
            Self::Scalar => true,
            #[cfg(target_arch = "x86_64")]
            Self::V3 => pulp::x86::V3::try_new().is_some(),
            #[cfg(target_arch = "x86_64")]
            Self::V4 => pulp::x86::V4::try_new().is_some(),
            #[cfg(target_arch = "aarch64")]
            Self::Neon => pulp::aarch64::Neon::try_new().is_some(),
        }
    }

    /// Return the current level. It is the fastest supported one, unless [`Level::choose`] has set
    /// another.
    #[must_use]
    pub fn current() -> Self {
        let mut index = CURRENT.load(Ordering::Relaxed);
        if index == UNKNOWN {
            let fastest = LEVELS.iter().rposition(|level| level.is_supported());
            index = fastest.unwrap_or_default() as u8;
            CURRENT.store(index, Ordering::Relaxed);
        }
        LEVELS[usize::from(index)]
    }

    /// Set the current level of all threads by its name, or to the fastest one for `None`.
    ///
    /// The results of different levels agree up to rounding. Integer results are identical. Choose a
    /// level only while no other function of the engine runs, because parts of one call expect the
    /// same level. Layers that have run keep their filters in groups for the registers of their
    /// first level. Their results are right at all levels, but they may be slower than new layers.
    ///
    /// # Errors
    /// [`Error::Range`] if the processor supports no level with this name.
    pub fn choose(name: Option<&str>) -> Result<()> {
        let index = match name {
            None => UNKNOWN,
            Some(name) => LEVELS
                .iter()
                .position(|level| level.is_supported() && level.name() == name)
                .ok_or_else(|| {
                    let names: Vec<_> = Self::supported().into_iter().map(Self::name).collect();
                    let expected = format!("one of {}", names.join(", "));
                    Error::range("instruction set", expected, name)
                })? as u8,
        };
        CURRENT.store(index, Ordering::Relaxed);
        Ok(())
    }
}

/// Return the x86-64-v4 instructions if they are the current level.
#[cfg(target_arch = "x86_64")]
pub(crate) fn v4() -> Option<pulp::x86::V4> {
    (Level::current() == Level::V4)
        .then(pulp::x86::V4::try_new)
        .flatten()
}

/// Return the x86-64-v3 instructions if they are the current level.
#[cfg(target_arch = "x86_64")]
pub(crate) fn v3() -> Option<pulp::x86::V3> {
    (Level::current() == Level::V3)
        .then(pulp::x86::V3::try_new)
        .flatten()
}

/// Run `work` with the vector instructions of the current level, and return its result.
pub(crate) fn run<W: WithSimd>(work: W) -> W::Output {
    match Level::current() {
        Level::Scalar => run_scalar(work),
        #[cfg(target_arch = "x86_64")]
        Level::V3 => run_with(pulp::x86::V3::try_new(), work),
        #[cfg(target_arch = "x86_64")]
        Level::V4 => run_with(pulp::x86::V4::try_new(), work),
        #[cfg(target_arch = "aarch64")]
        Level::Neon => run_with(pulp::aarch64::Neon::try_new(), work),
    }
}

/// Run `work` as [`run`] does, but never with the x86-64-v4 instructions.
///
/// The compiler gathers and scatters the words of some short loops with them, which is slow.
pub(crate) fn run_below_v4<W: WithSimd>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    if Level::current() == Level::V4 {
        return run_with(pulp::x86::V3::try_new(), work);
    }
    run(work)
}

fn run_with<W: WithSimd, S: Simd>(simd: Option<S>, work: W) -> W::Output {
    match simd {
        Some(simd) => simd.vectorize(work),
        None => run_scalar(work),
    }
}

/// Run `work` without vector instructions.
///
/// It is not inlined, so that this version of each hot loop is compiled once instead of three times.
#[inline(never)]
fn run_scalar<W: WithSimd>(work: W) -> W::Output {
    work.with_simd(Scalar::new())
}

/// Declare functions whose body is compiled for each level. A call runs the version for the current
/// level.
///
/// The body is another function, which must be `#[inline(always)]`:
/// `levels! { fn apply[F: Real](spline: &Spline<F>, plane: &mut [F]) = apply_inlined; }`
macro_rules! levels {
    ($(
        $(#[$attribute:meta])*
        $scope:vis fn $name:ident $([$($generics:tt)*])? ($($argument:ident: $type:ty),* $(,)?)
            = $inlined:path;
    )*) => {$(
        $(#[$attribute])*
        $scope fn $name $(<$($generics)*>)? ($($argument: $type),*) {
            struct Work<A>(A);
            impl $(<$($generics)*>)? $crate::cpu::WithSimd for Work<($($type,)*)> {
                type Output = ();
                #[inline(always)]
                fn with_simd<S: $crate::cpu::Simd>(self, _: S) {
                    let ($($argument,)*) = self.0;
                    $inlined($($argument),*);
                }
            }
            $crate::cpu::run(Work(($($argument,)*)));
        }
    )*};
}
pub(crate) use levels;
