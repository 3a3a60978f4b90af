//! Hostile arguments from the bytes of an input.

use arbitrary::Unstructured;
use jotlight::cpu::Level;

/// The source of arguments. The bytes of the input determine the sizes and the kinds of values.
/// They also seed a generator of random numbers, which fills arrays.
pub struct Input<'a> {
    bytes: Unstructured<'a>,
    state: u64,
}

impl<'a> Input<'a> {
    pub fn new(data: &'a [u8]) -> Self {
        let hash = |hash: u64, &byte: &u8| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        let mut input = Self {
            bytes: Unstructured::new(data),
            state: data.iter().fold(0xcbf2_9ce4_8422_2325, hash),
        };
        let levels = Level::supported();
        let level = input.below(levels.len());
        assert!(Level::choose(Some(levels[level].name())).is_ok());
        input
    }

    pub fn byte(&mut self) -> u8 {
        self.bytes.arbitrary().unwrap_or_default()
    }

    /// Return a number below `end`, which is at most 256.
    pub fn below(&mut self, end: usize) -> usize {
        usize::from(self.byte()) % end
    }

    /// Return true once in `times`.
    pub fn rarely(&mut self, times: usize) -> bool {
        self.below(times) == times - 1
    }

    /// Return a small size. It may be 0.
    pub fn size(&mut self) -> usize {
        match self.below(8) {
            0 => self.below(3),
            1..6 => 1 + self.below(6),
            _ => self.below(21),
        }
    }

    /// Return a size, but another one in rare cases, so that shapes do not match.
    pub fn almost(&mut self, size: usize) -> usize {
        if self.rarely(32) { self.size() } else { size }
    }

    /// Return any number, mostly a small one.
    pub fn number(&mut self) -> usize {
        match self.below(24) {
            0 => usize::MAX,
            1 => usize::MAX / 2 + 1,
            2 => 1 << 40,
            3 => 1 << 32,
            4 => u32::MAX as usize,
            5 => 1 << 31,
            6 => usize::from(u16::MAX) + self.below(3),
            7 => 4095 + self.below(3),
            8 => self.bytes.arbitrary().unwrap_or_default(),
            _ => self.size(),
        }
    }

    /// Return a threshold q, mostly a small one, and a length for its array of values. The time of a
    /// value grows with the square root of q.
    pub fn threshold_and_length(&mut self, length: usize) -> (u32, usize) {
        match self.below(16) {
            0..8 => (1, length),
            8..15 => (self.size() as u32, length),
            _ => (self.number() as u32, length.min(2)),
        }
    }

    pub fn count(&mut self) -> i32 {
        match self.below(16) {
            0 => i32::MAX,
            1 => i32::MIN,
            2 => -1,
            3 => 1 << 30,
            _ => self.size() as i32,
        }
    }

    /// Return a float of any kind.
    pub fn float(&mut self) -> f64 {
        let kind = self.byte();
        let bits = self.random();
        float_of_kind(kind, bits)
    }

    /// Return a random number. It does not use up the bytes.
    pub fn random(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.state ^ self.state >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ mixed >> 31
    }

    /// Return `length` random bytes.
    pub fn random_bytes(&mut self, length: usize) -> Vec<u8> {
        (0..length).map(|_| self.random() as u8).collect()
    }

    /// Return `length` floats: ordinary ones, or also hostile ones.
    pub fn floats(&mut self, length: usize) -> Vec<f64> {
        let hostile = self.rarely(3);
        let values = (0..length).map(|_| {
            let bits = self.random();
            let kind = if hostile { bits >> 56 } else { 255 };
            float_of_kind(kind as u8, bits)
        });
        values.collect()
    }

    /// Return `length` counts from 0 to `max`, or also invalid ones in rare cases.
    pub fn counts(&mut self, length: usize, max: i32) -> Vec<i32> {
        let hostile = self.rarely(32);
        let values = (0..length).map(|_| {
            if hostile {
                self.random() as i32
            } else {
                (self.random() % (max.max(0) as u64 + 1)) as i32
            }
        });
        values.collect()
    }

    pub fn seed(&mut self) -> [u8; 32] {
        [self.byte(); 32]
    }
}

fn float_of_kind(kind: u8, bits: u64) -> f64 {
    match kind {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => f64::NEG_INFINITY,
        3 => 0.0,
        4 => -0.0,
        5 => f64::MIN_POSITIVE,
        6 => f64::from_bits(1 + bits % 1000),
        7 => f64::MAX,
        8 => f64::MIN,
        9 => f64::from(f32::MAX) * 0.999,
        10 => f64::from(f32::MIN_POSITIVE) * 1e-3,
        11 => -1.0,
        12 => 65_535.0 + (bits % 3) as f64,
        13..40 => f64::from_bits(bits),
        40..80 => f64::from(f32::from_bits(bits as u32)),
        80..120 => 10f64.powi((bits % 40) as i32 - 20),
        _ => (bits % 4096) as f64 / 256.0,
    }
}
