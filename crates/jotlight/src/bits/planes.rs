//! Ones of each jot over many frames, summed in the packed domain: counters whose digits are bit planes, so that one
//! operation on a word adds to 64 of them.

use crate::cpu::levels;

/// Frames that are added at a time.
pub(super) const GROUP: usize = 8;

/// The weight of a group's carry is 2 to this power.
const CARRY: usize = GROUP.trailing_zeros() as usize;

/// A counter for each bit of a stretch of bytes. Digit `l` of all of them is the plane `sums[l]`; a plane that is to be
/// added waits until there is another one, since a full adder takes three.
pub(super) struct Planes {
    words: usize,
    sums: Vec<Vec<u64>>,
    waiting: Vec<Option<Vec<u64>>>,
    spare: Vec<Vec<u64>>,
}

impl Planes {
    pub(super) fn new(bytes: usize) -> Self {
        let words = bytes.div_ceil(8);
        Self {
            words,
            sums: vec![vec![0; words]; CARRY],
            waiting: vec![None; CARRY],
            spare: Vec::new(),
        }
    }

    /// Adds eight stretches of bytes, all of the length that was said.
    pub(super) fn add(&mut self, group: &[&[u8]; GROUP]) {
        let mut carry = self.spare.pop().unwrap_or_else(|| vec![0; self.words]);
        let (low, _) = self.sums.split_at_mut(CARRY);
        if let [ones, twos, fours] = low {
            add_group(group, ones, twos, fours, &mut carry);
        }
        self.push(CARRY, carry);
    }

    /// Adds a plane of weight 2^`level`.
    fn push(&mut self, mut level: usize, mut plane: Vec<u64>) {
        loop {
            if self.sums.len() == level {
                self.sums.push(vec![0; self.words]);
                self.waiting.push(None);
            }
            match self.waiting[level].take() {
                None => {
                    self.waiting[level] = Some(plane);
                    return;
                }
                Some(other) => {
                    // What is carried takes the place of the plane.
                    add_planes(&mut self.sums[level], &other, &mut plane);
                    self.spare.push(other);
                    level += 1;
                }
            }
        }
    }

    /// Adds the counters of some bytes to `counts`, one for each bit, the most significant first, and leaves off where these end.
    pub(super) fn add_to(&self, bytes: std::ops::Range<usize>, counts: &mut [i32]) {
        for (level, (sum, waiting)) in self.sums.iter().zip(&self.waiting).enumerate() {
            for plane in std::iter::once(sum).chain(waiting) {
                expand(plane, bytes.start, level as u32, counts);
            }
        }
    }
}

/// Sum and carry of three bits, for 64 at a time.
#[inline(always)]
fn full_adder(a: u64, b: u64, c: u64) -> (u64, u64) {
    let half = a ^ b;
    (half ^ c, a & b | half & c)
}

/// One word of a group: added to the digits of weight 1, 2 and 4; gives what is carried on.
#[inline(always)]
fn add_words(x: [u64; GROUP], ones: &mut u64, twos: &mut u64, fours: &mut u64) -> u64 {
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
    /// Adds eight stretches of bytes to the digits of weight 1, 2 and 4, and gives what is carried on.
    fn add_group(
        group: &[&[u8]; GROUP], ones: &mut [u64], twos: &mut [u64], fours: &mut [u64],
        carry: &mut [u64],
    ) = add_group_inlined;
    /// Adds two planes to a digit, and leaves what is carried in the second of them.
    fn add_planes(sum: &mut [u64], one: &[u64], other: &mut [u64]) = add_planes_inlined;
    /// Adds 2^`level` to the counts of the bits that are set in the bytes of a plane from `first` on.
    fn expand(plane: &[u64], first: usize, level: u32, counts: &mut [i32]) = expand_inlined;
}

#[inline(always)]
fn add_group_inlined(
    group: &[&[u8]; GROUP],
    ones: &mut [u64],
    twos: &mut [u64],
    fours: &mut [u64],
    carry: &mut [u64],
) {
    let whole = group[0].len() / 8;
    let [a, b, c, d, e, f, g, h] = group.map(|bytes| &bytes.as_chunks::<8>().0[..whole]);
    let (ones_whole, twos_whole) = (&mut ones[..whole], &mut twos[..whole]);
    let (fours_whole, carry_whole) = (&mut fours[..whole], &mut carry[..whole]);
    for i in 0..whole {
        let x = [a[i], b[i], c[i], d[i], e[i], f[i], g[i], h[i]].map(u64::from_ne_bytes);
        carry_whole[i] = add_words(
            x,
            &mut ones_whole[i],
            &mut twos_whole[i],
            &mut fours_whole[i],
        );
    }
    if whole < carry.len() {
        let x = group.map(|bytes| {
            let mut word = [0; 8];
            let rest = &bytes[8 * whole..];
            word[..rest.len()].copy_from_slice(rest);
            u64::from_ne_bytes(word)
        });
        carry[whole] = add_words(x, &mut ones[whole], &mut twos[whole], &mut fours[whole]);
    }
}

#[inline(always)]
fn add_planes_inlined(sum: &mut [u64], one: &[u64], other: &mut [u64]) {
    for ((sum, &one), other) in sum.iter_mut().zip(one).zip(other) {
        (*sum, *other) = full_adder(*sum, one, *other);
    }
}

#[inline(always)]
fn expand_inlined(plane: &[u64], first: usize, level: u32, counts: &mut [i32]) {
    let (eights, rest) = counts.as_chunks_mut::<8>();
    let last = first + eights.len();
    let byte_at = |index: usize| plane[index / 8].to_ne_bytes()[index % 8];
    for (index, counts) in (first..).zip(eights) {
        let byte = i32::from(byte_at(index));
        for (place, count) in counts.iter_mut().enumerate() {
            *count += (byte >> (7 - place) & 1) << level;
        }
    }
    if !rest.is_empty() {
        let byte = i32::from(byte_at(last));
        for (place, count) in rest.iter_mut().enumerate() {
            *count += (byte >> (7 - place) & 1) << level;
        }
    }
}
