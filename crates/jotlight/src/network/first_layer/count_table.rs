//! A function of counts, by table.

use crate::cpu::levels;
use crate::numbers::Real;

/// Entries that a byte tells apart: in a table with so many, indices need not be checked.
const SMALL: usize = 256;

/// What a count amounts to.
pub(crate) enum Table<F> {
    Small(Box<[F; SMALL]>),
    Large(Vec<F>),
}

impl<F: Real> Table<F> {
    pub fn new(values: &[F]) -> Self {
        if values.len() > SMALL {
            return Self::Large(values.to_vec());
        }
        let mut table = Box::new([F::zero(); SMALL]);
        table[..values.len()].copy_from_slice(values);
        Self::Small(table)
    }

    /// The values of counts that are in the table.
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
