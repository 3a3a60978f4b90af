//! A table of the output of the first layer for each count. It requires tied filters.

use crate::cpu::levels;
use crate::numbers::Real;

/// The length of a small table. An index of one byte needs no bounds check.
const SMALL: usize = 256;

/// The values of a function of a count, from count 0 on.
pub(crate) enum CountTable<F> {
    Small(Box<[F; SMALL]>),
    Large(Vec<F>),
}

impl<F: Real> CountTable<F> {
    pub fn new(values: &[F]) -> Self {
        if values.len() > SMALL {
            return Self::Large(values.to_vec());
        }
        let mut table = Box::new([F::zero(); SMALL]);
        table[..values.len()].copy_from_slice(values);
        Self::Small(table)
    }

    /// Write the value for each count into `out`. The table must contain all counts.
    pub fn look_up(&self, counts: &[i32], out: &mut [F]) {
        match self {
            Self::Small(table) => look_up(table, counts, out),
            Self::Large(table) => {
                for (out, &count) in out.iter_mut().zip(counts) {
                    *out = table[count as usize];
                }
            }
        }
    }
}

levels! {
    fn look_up[F: Real](table: &[F; SMALL], counts: &[i32], out: &mut [F]) = look_up_inlined;
}

#[inline(always)]
fn look_up_inlined<F: Real>(table: &[F; SMALL], counts: &[i32], out: &mut [F]) {
    for (out, &count) in out.iter_mut().zip(counts) {
        *out = table[usize::from(count as u8)];
    }
}
