//! Instruction sets: the hot loops are written once and compiled for several, of which a probe chooses the best that the
//! processor has. Tests may choose another one.

use std::sync::atomic::{AtomicU8, Ordering};

use pulp::Scalar;
pub use pulp::{Simd, WithSimd};

use crate::error::{Error, Result};

/// What the hot loops are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// One number at a time.
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

/// All levels, the better the later.
const LEVELS: &[Level] = &[
    Level::Scalar,
    #[cfg(target_arch = "x86_64")]
    Level::V3,
    #[cfg(target_arch = "x86_64")]
    Level::V4,
    #[cfg(target_arch = "aarch64")]
    Level::Neon,
];

/// Place in [`LEVELS`] of the one in use, once it is known.
static CHOSEN: AtomicU8 = AtomicU8::new(UNKNOWN);
const UNKNOWN: u8 = u8::MAX;

impl Level {
    /// Its name.
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

    /// Those that this processor has.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let mut levels = LEVELS.to_vec();
        levels.retain(|level| level.is_there());
        levels
    }

    fn is_there(self) -> bool {
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

    /// The one in use: the best that there is, unless another was chosen.
    #[must_use]
    pub fn current() -> Self {
        let mut chosen = CHOSEN.load(Ordering::Relaxed);
        if chosen == UNKNOWN {
            let best = LEVELS.iter().rposition(|level| level.is_there());
            chosen = best.unwrap_or_default() as u8;
            CHOSEN.store(chosen, Ordering::Relaxed);
        }
        LEVELS[usize::from(chosen)]
    }

    /// Uses the level of that name from now on in all threads, or the best again. Results agree within rounding, and are the same bits for
    /// whole numbers.
    ///
    /// # Errors
    /// [`Error::Shape`] when the processor has none of that name.
    pub fn choose(name: Option<&str>) -> Result<()> {
        let chosen = match name {
            None => UNKNOWN,
            Some(name) => LEVELS
                .iter()
                .position(|level| level.is_there() && level.name() == name)
                .ok_or_else(|| {
                    let names: Vec<_> = Self::all().into_iter().map(Self::name).collect();
                    Error::shape("instruction set", names.join(", "), name)
                })? as u8,
        };
        CHOSEN.store(chosen, Ordering::Relaxed);
        Ok(())
    }
}

/// The instructions of x86-64-v4, where these are in use.
#[cfg(target_arch = "x86_64")]
pub fn v4() -> Option<pulp::x86::V4> {
    (Level::current() == Level::V4)
        .then(pulp::x86::V4::try_new)
        .flatten()
}

/// Runs work that is written in vectors, on those of the level in use.
pub fn run<W: WithSimd>(work: W) -> W::Output {
    match Level::current() {
        Level::Scalar => work.with_simd(Scalar::new()),
        #[cfg(target_arch = "x86_64")]
        Level::V3 => on(pulp::x86::V3::try_new(), work),
        #[cfg(target_arch = "x86_64")]
        Level::V4 => on(pulp::x86::V4::try_new(), work),
        #[cfg(target_arch = "aarch64")]
        Level::Neon => on(pulp::aarch64::Neon::try_new(), work),
    }
}

fn on<W: WithSimd, S: Simd>(simd: Option<S>, work: W) -> W::Output {
    match simd {
        Some(simd) => simd.vectorize(work),
        None => work.with_simd(Scalar::new()),
    }
}

/// Declares functions that run another, which has to be inlined always, compiled for the level in use:
/// `levels! { fn apply[F: Real](spline: &Spline<F>, plane: &mut [F]) = apply_inlined; }`
macro_rules! levels {
    ($($(#[$attribute:meta])* $scope:vis fn $name:ident $([$($generics:tt)*])? ($($argument:ident: $type:ty),* $(,)?) = $inlined:path;)*) => {$(
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
