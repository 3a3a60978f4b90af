//! Ways to draw the bits of jots, in nanoseconds per jot on one thread.
//!
//!     rustc -O -C target-cpu=native --edition 2024 -o drawing benchmarks/speed/drawing.rs
//!     ./drawing
//!
//! The program compares generators of random bytes, and ways to compare random bits with
//! probabilities of 16 bits. It needs AVX-512 with VAES.

use std::arch::x86_64::*;
use std::hint::black_box;
use std::time::Instant;

const JOTS: usize = 2048;

fn main() {
    let mut bytes = vec![0u8; 2 * JOTS];
    measure("ChaCha8, 8 bits per jot", || unsafe {
        chacha(&mut bytes[..JOTS])
    });
    measure("AES-128 in counter mode, 8 bits per jot", || unsafe {
        aes(&mut bytes[..JOTS])
    });
    measure("ChaCha8, 16 bits per jot", || unsafe { chacha(&mut bytes) });

    let probabilities: Vec<u16> = (0..JOTS as u32).map(|k| (k * 40503) as u16).collect();
    let high: Vec<u8> = probabilities.iter().map(|p| (p >> 8) as u8).collect();
    let mut masks = vec![(0u64, 0u64); JOTS / 64];
    measure("comparison of 8 bits", || unsafe {
        compare(&bytes, &high, &mut masks)
    });

    let mut planes = vec![[0u64; 16]; JOTS / 64];
    measure("transposition of probabilities to bit planes", || unsafe {
        transpose(black_box(&probabilities), &mut planes);
    });
    let mut words = vec![0u64; JOTS / 64];
    let mut used = 0;
    measure("bit-sliced comparison, 64 jots at a time", || {
        used = slice_words(&planes, &bytes, &mut words)
    });
    println!(
        "{:6.2} random bits per jot",
        used as f64 * 64.0 / JOTS as f64
    );
    let together: Vec<[[u64; 8]; 16]> = planes
        .as_chunks::<8>()
        .0
        .iter()
        .map(|words| std::array::from_fn(|bit| std::array::from_fn(|word| words[word][bit])))
        .collect();
    measure("bit-sliced comparison, 512 jots at a time", || {
        used = slice_registers(&together, &bytes, &mut words)
    });
    println!(
        "{:6.2} random bits per jot",
        used as f64 * 512.0 / JOTS as f64
    );
}

fn measure(name: &str, mut work: impl FnMut()) {
    let mut best = f64::INFINITY;
    for _ in 0..200 {
        let begin = Instant::now();
        for _ in 0..50 {
            black_box(&mut work)();
        }
        best = best.min(begin.elapsed().as_secs_f64() / 50.0);
    }
    println!("{:6.3} ns per jot: {name}", best * 1e9 / JOTS as f64);
}

/// Fill bytes with sixteen blocks of ChaCha8 at a time. The words of the blocks are interleaved.
#[target_feature(enable = "avx512f")]
fn chacha(bytes: &mut [u8]) {
    for (group, bytes) in bytes.chunks_exact_mut(1024).enumerate() {
        let mut start = [_mm512_set1_epi32(black_box(7)); 16];
        start[12] = _mm512_set1_epi32(black_box(group as i32));
        let mut x = start;
        macro_rules! quarter_round {
            ($a:literal, $b:literal, $c:literal, $d:literal) => {
                x[$a] = _mm512_add_epi32(x[$a], x[$b]);
                x[$d] = _mm512_rol_epi32::<16>(_mm512_xor_si512(x[$d], x[$a]));
                x[$c] = _mm512_add_epi32(x[$c], x[$d]);
                x[$b] = _mm512_rol_epi32::<12>(_mm512_xor_si512(x[$b], x[$c]));
                x[$a] = _mm512_add_epi32(x[$a], x[$b]);
                x[$d] = _mm512_rol_epi32::<8>(_mm512_xor_si512(x[$d], x[$a]));
                x[$c] = _mm512_add_epi32(x[$c], x[$d]);
                x[$b] = _mm512_rol_epi32::<7>(_mm512_xor_si512(x[$b], x[$c]));
            };
        }
        for _ in 0..4 {
            quarter_round!(0, 4, 8, 12);
            quarter_round!(1, 5, 9, 13);
            quarter_round!(2, 6, 10, 14);
            quarter_round!(3, 7, 11, 15);
            quarter_round!(0, 5, 10, 15);
            quarter_round!(1, 6, 11, 12);
            quarter_round!(2, 7, 8, 13);
            quarter_round!(3, 4, 9, 14);
        }
        for (word, out) in bytes.chunks_exact_mut(64).enumerate() {
            let sum = _mm512_add_epi32(x[word], start[word]);
            unsafe { _mm512_storeu_si512(out.as_mut_ptr().cast(), sum) };
        }
    }
}

/// Fill bytes with AES-128 in counter mode, 32 blocks at a time.
#[target_feature(enable = "avx512f,vaes")]
fn aes(bytes: &mut [u8]) {
    let keys: [__m512i; 11] =
        std::array::from_fn(|round| _mm512_set1_epi64(black_box(round as i64)));
    for (group, bytes) in bytes.chunks_exact_mut(512).enumerate() {
        let mut x: [__m512i; 8] = std::array::from_fn(|register| {
            let counter = (32 * group + 4 * register) as i64;
            let counters =
                _mm512_set_epi64(0, counter + 3, 0, counter + 2, 0, counter + 1, 0, counter);
            _mm512_xor_si512(counters, keys[0])
        });
        for key in &keys[1..10] {
            for x in &mut x {
                *x = _mm512_aesenc_epi128(*x, *key);
            }
        }
        for (x, out) in x.iter().zip(bytes.chunks_exact_mut(64)) {
            let last = _mm512_aesenclast_epi128(*x, keys[10]);
            unsafe { _mm512_storeu_si512(out.as_mut_ptr().cast(), last) };
        }
    }
}

/// Compare draws with the high bytes of probabilities: the masks of smaller and of equal ones.
#[target_feature(enable = "avx512bw")]
fn compare(draws: &[u8], high: &[u8], masks: &mut [(u64, u64)]) {
    let pairs = draws.chunks_exact(64).zip(high.chunks_exact(64));
    for ((draws, high), masks) in pairs.zip(masks) {
        let load = |bytes: &[u8]| unsafe { _mm512_loadu_si512(bytes.as_ptr().cast()) };
        let (draws, high) = (load(draws), load(high));
        let equal = _mm512_cmpeq_epu8_mask(draws, high);
        *masks = (_mm512_cmplt_epu8_mask(draws, high), equal);
    }
}

/// Write the bits of equal significance of 64 probabilities to one word.
#[target_feature(enable = "avx512bw")]
fn transpose(probabilities: &[u16], planes: &mut [[u64; 16]]) {
    for (probabilities, planes) in probabilities.chunks_exact(64).zip(planes) {
        let load = |part: &[u16]| unsafe { _mm512_loadu_si512(part.as_ptr().cast()) };
        let [mut first, mut second] = [load(&probabilities[..32]), load(&probabilities[32..])];
        for plane in planes {
            let [low, high] = [first, second].map(|half| u64::from(_mm512_movepi16_mask(half)));
            *plane = high << 32 | low;
            first = _mm512_add_epi16(first, first);
            second = _mm512_add_epi16(second, second);
        }
    }
}

/// Compare bit by bit until 64 jots are decided, and return the number of random words.
fn slice_words(planes: &[[u64; 16]], random: &[u8], words: &mut [u64]) -> usize {
    let mut random = random
        .chunks_exact(8)
        .map(|bytes| u64::from_le_bytes(bytes.try_into().unwrap()))
        .cycle();
    let mut used = 0;
    for (planes, word) in planes.iter().zip(words) {
        let (mut ones, mut open) = (0, u64::MAX);
        for plane in planes {
            let draw = random.next().unwrap();
            used += 1;
            ones |= open & plane & !draw;
            open &= !(plane ^ draw);
            if open == 0 {
                break;
            }
        }
        *word = ones;
    }
    used
}

/// Do the same for 512 jots at a time. The planes of eight words lie together.
fn slice_registers(planes: &[[[u64; 8]; 16]], random: &[u8], words: &mut [u64]) -> usize {
    let random = random.as_chunks::<64>().0;
    let mut used = 0;
    for (planes, words) in planes.iter().zip(words.chunks_exact_mut(8)) {
        let (mut ones, mut open) = ([0; 8], [u64::MAX; 8]);
        for plane in planes {
            let draw = random[used % 32].as_chunks::<8>().0;
            used += 1;
            for lane in 0..8 {
                let draw = u64::from_le_bytes(draw[lane]);
                ones[lane] |= open[lane] & plane[lane] & !draw;
                open[lane] &= !(plane[lane] ^ draw);
            }
            if open.iter().fold(0, |all, lane| all | lane) == 0 {
                break;
            }
        }
        words.copy_from_slice(&ones);
    }
    used
}
