//! Counts of the ones of each jot over many frames, without unpacking the bits.
//!
//! Each jot has a counter. A bit plane stores the same binary digit of all counters, so one
//! operation on a word updates 64 counters.

use super::first_word;
use crate::cpu::levels;

/// The number of frames that are added together.
pub(crate) const FRAMES_PER_GROUP: usize = 8;

/// The exponent of the weight of the carry of a group. The weight is 2^`CARRY_EXPONENT`.
const CARRY_EXPONENT: usize = FRAMES_PER_GROUP.trailing_zeros() as usize;

/// The number of digits whose planes are added in bytes. There are up to two planes for each digit,
/// and 2 · (2^7 - 1) is less than 2^8.
const DIGITS_PER_SUM: usize = 7;

/// Eight bytes of a plane: one digit of 64 counters.
type Word = [u8; 8];

/// One counter for each bit of a sequence of bytes.
pub(crate) struct BitCounters {
    words: usize,
    /// The digits of all counters. `digits[exponent]` has the weight 2^exponent.
    digits: Vec<Vec<Word>>,
    /// For each digit, a plane that waits for a second one. The full adder adds two planes at once.
    pending: Vec<Option<Vec<Word>>>,
    /// Planes for reuse.
    free: Vec<Vec<Word>>,
}

impl BitCounters {
    pub(crate) fn new(bytes: usize) -> Self {
        let words = bytes.div_ceil(8);
        Self {
            words,
            digits: vec![vec![[0; 8]; words]; CARRY_EXPONENT],
            pending: vec![None; CARRY_EXPONENT],
            free: Vec::new(),
        }
    }

    /// Set all counters to 0.
    pub(crate) fn clear(&mut self) {
        for digit in &mut self.digits {
            digit.fill([0; 8]);
        }
        self.free
            .extend(self.pending.iter_mut().filter_map(Option::take));
    }

    /// Add a group of byte sequences. Each has the length `bytes` of [`BitCounters::new`].
    pub(crate) fn add(&mut self, group: &[&[u8]; FRAMES_PER_GROUP]) {
        let mut carry = self.free.pop().unwrap_or_else(|| vec![[0; 8]; self.words]);
        let (low, _) = self.digits.split_at_mut(CARRY_EXPONENT);
        if let [ones, twos, fours] = low {
            add_group(group, ones, twos, fours, &mut carry);
        }
        self.add_plane(CARRY_EXPONENT, carry);
    }

    /// Add a plane of weight 2^`exponent`.
    fn add_plane(&mut self, mut exponent: usize, mut plane: Vec<Word>) {
        loop {
            if self.digits.len() == exponent {
                self.digits.push(vec![[0; 8]; self.words]);
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
    pub(crate) fn add_to_counts(&self, bytes: std::ops::Range<usize>, counts: &mut [i32]) {
        let mut planes = Vec::with_capacity(2 * DIGITS_PER_SUM);
        for first in (0..self.digits.len()).step_by(DIGITS_PER_SUM) {
            let digits = self.digits[first..].iter().zip(&self.pending[first..]);
            planes.clear();
            for (exponent, (digit, pending)) in (0..).zip(digits.take(DIGITS_PER_SUM)) {
                for plane in std::iter::once(digit).chain(pending) {
                    planes.push((exponent, &plane.as_flattened()[bytes.clone()]));
                }
            }
            add_planes_to_counts(&planes, first, counts);
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
fn add_words(
    x: [Word; FRAMES_PER_GROUP],
    ones: &mut Word,
    twos: &mut Word,
    fours: &mut Word,
) -> Word {
    let x = x.map(u64::from_ne_bytes);
    let [one, two, four] = [*ones, *twos, *fours].map(u64::from_ne_bytes);
    let (one, two_a) = full_adder(one, x[0], x[1]);
    let (one, two_b) = full_adder(one, x[2], x[3]);
    let (two, four_a) = full_adder(two, two_a, two_b);
    let (one, two_a) = full_adder(one, x[4], x[5]);
    let (one, two_b) = full_adder(one, x[6], x[7]);
    let (two, four_b) = full_adder(two, two_a, two_b);
    let (four, carry) = full_adder(four, four_a, four_b);
    [*ones, *twos, *fours] = [one, two, four].map(u64::to_ne_bytes);
    carry.to_ne_bytes()
}

levels! {
    /// Add a group of byte sequences to the digits of weight 1, 2, and 4, and write the carry.
    fn add_group(
        group: &[&[u8]; FRAMES_PER_GROUP], ones: &mut [Word], twos: &mut [Word], fours: &mut [Word],
        carry: &mut [Word],
    ) = add_group_inlined;
    /// Add two planes to a digit. The carry replaces the second plane.
    fn add_planes(digit: &mut [Word], first: &[Word], second: &mut [Word]) = add_planes_inlined;
    /// Add planes and their exponents to counts, times 2^`first_exponent`.
    fn add_planes_to_counts(
        planes: &[(u32, &[u8])], first_exponent: usize, counts: &mut [i32],
    ) = add_planes_to_counts_inlined;
}

#[inline(always)]
fn add_group_inlined(
    group: &[&[u8]; FRAMES_PER_GROUP],
    ones: &mut [Word],
    twos: &mut [Word],
    fours: &mut [Word],
    carry: &mut [Word],
) {
    let whole_words = group[0].len() / 8;
    let [a, b, c, d, e, f, g, h] = group.map(|bytes| &bytes.as_chunks::<8>().0[..whole_words]);
    let (whole_ones, whole_twos) = (&mut ones[..whole_words], &mut twos[..whole_words]);
    let (whole_fours, whole_carry) = (&mut fours[..whole_words], &mut carry[..whole_words]);
    for i in 0..whole_words {
        whole_carry[i] = add_words(
            [a[i], b[i], c[i], d[i], e[i], f[i], g[i], h[i]],
            &mut whole_ones[i],
            &mut whole_twos[i],
            &mut whole_fours[i],
        );
    }
    if whole_words < carry.len() {
        let x = group.map(|bytes| first_word(&bytes[8 * whole_words..]));
        carry[whole_words] = add_words(
            x,
            &mut ones[whole_words],
            &mut twos[whole_words],
            &mut fours[whole_words],
        );
    }
}

#[inline(always)]
fn add_planes_inlined(digit: &mut [Word], first: &[Word], second: &mut [Word]) {
    for ((digit, &first), second) in digit.iter_mut().zip(first).zip(second) {
        let words = [*digit, first, *second].map(u64::from_ne_bytes);
        let (sum, carry) = full_adder(words[0], words[1], words[2]);
        (*digit, *second) = (sum.to_ne_bytes(), carry.to_ne_bytes());
    }
}

#[inline(always)]
fn add_planes_to_counts_inlined(
    planes: &[(u32, &[u8])],
    first_exponent: usize,
    counts: &mut [i32],
) {
    for (index, counts) in counts.chunks_mut(64).enumerate() {
        let mut sums = [0; 8];
        for (exponent, plane) in planes {
            for (sum, byte) in sums.iter_mut().zip(first_word(&plane[8 * index..])) {
                *sum += spread(byte) << exponent;
            }
        }
        let sums = sums.map(u64::to_le_bytes);
        for (count, &sum) in counts.iter_mut().zip(sums.as_flattened()) {
            *count += i32::from(sum) << first_exponent;
        }
    }
}

/// Return the bits of a byte as eight bytes. The most significant bit becomes the lowest byte.
#[inline(always)]
fn spread(byte: u8) -> u64 {
    // The product has copies of the byte at bits 0, 9, ..., 63, which do not overlap. So bit 7 + 8k
    // of the product is bit 7 - k of the byte.
    u64::from(byte).wrapping_mul(0x8040_2010_0804_0201) >> 7 & 0x0101_0101_0101_0101
}
