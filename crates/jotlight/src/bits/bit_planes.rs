//! Counts of the ones of each jot over many frames, without unpacking the bits.
//!
//! Each jot has a counter. A bit plane stores the same binary digit of all counters, so one
//! operation on a word updates 64 counters.

use crate::cpu::levels;

/// The number of frames that are added together.
pub(super) const FRAMES_PER_GROUP: usize = 8;

/// The exponent of the weight of the carry of a group. The weight is 2^`CARRY_EXPONENT`.
const CARRY_EXPONENT: usize = FRAMES_PER_GROUP.trailing_zeros() as usize;

/// One counter for each bit of a sequence of bytes.
pub(super) struct BitCounters {
    words: usize,
    /// The digits of all counters. `digits[exponent]` has the weight 2^exponent.
    digits: Vec<Vec<u64>>,
    /// For each digit, a plane that waits for a second one. The full adder adds two planes at once.
    pending: Vec<Option<Vec<u64>>>,
    /// Planes for reuse.
    free: Vec<Vec<u64>>,
}

impl BitCounters {
    pub(super) fn new(bytes: usize) -> Self {
        let words = bytes.div_ceil(8);
        Self {
            words,
            digits: vec![vec![0; words]; CARRY_EXPONENT],
            pending: vec![None; CARRY_EXPONENT],
            free: Vec::new(),
        }
    }

    /// Add a group of byte sequences. Each has the length `bytes` of [`BitCounters::new`].
    pub(super) fn add(&mut self, group: &[&[u8]; FRAMES_PER_GROUP]) {
        let mut carry = self.free.pop().unwrap_or_else(|| vec![0; self.words]);
        let (low, _) = self.digits.split_at_mut(CARRY_EXPONENT);
        if let [ones, twos, fours] = low {
            add_group(group, ones, twos, fours, &mut carry);
        }
        self.add_plane(CARRY_EXPONENT, carry);
    }

    /// Add a plane of weight 2^`exponent`.
    fn add_plane(&mut self, mut exponent: usize, mut plane: Vec<u64>) {
        loop {
            if self.digits.len() == exponent {
                self.digits.push(vec![0; self.words]);
                self.pending.push(None);
            }
            match self.pending[exponent].take() {
                None => {
                    self.pending[exponent] = Some(plane);
                    return;
                }
                Some(other) => {
                    // The carry replaces the plane.
                    add_planes(&mut self.digits[exponent], &other, &mut plane);
                    self.free.push(other);
                    exponent += 1;
                }
            }
        }
    }

    /// Add the counters of a range of bytes to `counts`, most significant bit first.
    ///
    /// Counters past the end of `counts` are ignored.
    pub(super) fn add_to_counts(&self, bytes: std::ops::Range<usize>, counts: &mut [i32]) {
        for (exponent, (digit, pending)) in self.digits.iter().zip(&self.pending).enumerate() {
            for plane in std::iter::once(digit).chain(pending) {
                add_plane_to_counts(plane, bytes.start, exponent as u32, counts);
            }
        }
    }
}

/// Return the sum and the carry of three bits, for 64 positions at once.
#[inline(always)]
fn full_adder(a: u64, b: u64, c: u64) -> (u64, u64) {
    let half = a ^ b;
    (half ^ c, a & b | half & c)
}

/// Add one word from each member of a group to the digits of weight 1, 2, and 4. Return the carry.
#[inline(always)]
fn add_words(x: [u64; FRAMES_PER_GROUP], ones: &mut u64, twos: &mut u64, fours: &mut u64) -> u64 {
    let (one, two_a) = full_adder(*ones, x[0], x[1]);
    let (one, two_b) = full_adder(one, x[2], x[3]);
    let (two, four_a) = full_adder(*twos, two_a, two_b);
    let (one, two_a) = full_adder(one, x[4], x[5]);
    let (one, two_b) = full_adder(one, x[6], x[7]);
    let (two, four_b) = full_adder(two, two_a, two_b);
    let (four, carry) = full_adder(*fours, four_a, four_b);
    (*ones, *twos, *fours) = (one, two, four);
    carry
}

levels! {
    /// Add a group of byte sequences to the digits of weight 1, 2, and 4, and write the carry.
    fn add_group(
        group: &[&[u8]; FRAMES_PER_GROUP], ones: &mut [u64], twos: &mut [u64], fours: &mut [u64],
        carry: &mut [u64],
    ) = add_group_inlined;
    /// Add two planes to a digit. The carry replaces the second plane.
    fn add_planes(digit: &mut [u64], first: &[u64], second: &mut [u64]) = add_planes_inlined;
    /// Add 2^`exponent` to the count of each bit that is set in a plane, starting at byte `first`.
    fn add_plane_to_counts(
        plane: &[u64], first: usize, exponent: u32, counts: &mut [i32],
    ) = add_plane_to_counts_inlined;
}

#[inline(always)]
fn add_group_inlined(
    group: &[&[u8]; FRAMES_PER_GROUP],
    ones: &mut [u64],
    twos: &mut [u64],
    fours: &mut [u64],
    carry: &mut [u64],
) {
    let whole_words = group[0].len() / 8;
    let [a, b, c, d, e, f, g, h] = group.map(|bytes| &bytes.as_chunks::<8>().0[..whole_words]);
    let (whole_ones, whole_twos) = (&mut ones[..whole_words], &mut twos[..whole_words]);
    let (whole_fours, whole_carry) = (&mut fours[..whole_words], &mut carry[..whole_words]);
    for i in 0..whole_words {
        let x = [a[i], b[i], c[i], d[i], e[i], f[i], g[i], h[i]].map(u64::from_ne_bytes);
        whole_carry[i] = add_words(
            x,
            &mut whole_ones[i],
            &mut whole_twos[i],
            &mut whole_fours[i],
        );
    }
    if whole_words < carry.len() {
        let x = group.map(|bytes| {
            let mut word = [0; 8];
            let rest = &bytes[8 * whole_words..];
            word[..rest.len()].copy_from_slice(rest);
            u64::from_ne_bytes(word)
        });
        carry[whole_words] = add_words(
            x,
            &mut ones[whole_words],
            &mut twos[whole_words],
            &mut fours[whole_words],
        );
    }
}

#[inline(always)]
fn add_planes_inlined(digit: &mut [u64], first: &[u64], second: &mut [u64]) {
    for ((digit, &first), second) in digit.iter_mut().zip(first).zip(second) {
        (*digit, *second) = full_adder(*digit, first, *second);
    }
}

#[inline(always)]
fn add_plane_to_counts_inlined(plane: &[u64], first: usize, exponent: u32, counts: &mut [i32]) {
    let (eights, rest) = counts.as_chunks_mut::<8>();
    let last = first + eights.len();
    let byte_at = |index: usize| plane[index / 8].to_ne_bytes()[index % 8];
    for (index, counts) in (first..).zip(eights) {
        let byte = i32::from(byte_at(index));
        for (position, count) in counts.iter_mut().enumerate() {
            *count += (byte >> (7 - position) & 1) << exponent;
        }
    }
    if !rest.is_empty() {
        let byte = i32::from(byte_at(last));
        for (position, count) in rest.iter_mut().enumerate() {
            *count += (byte >> (7 - position) & 1) << exponent;
        }
    }
}
