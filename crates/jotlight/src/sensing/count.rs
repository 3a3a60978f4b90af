//! Random counts L ~ Binomial(K, P(b = 1)) of pixels, drawn without their bits (paper, equation
//! (3)).

use ndarray::ArrayViewMut2;

use super::exposure::convert;
use super::{Image, PerJot, Sensor};
use crate::bits::{contiguous, trials};
use crate::cpu::{self, Simd, WithSimd, levels};
use crate::elementary::{ELEMENTS_PER_GROUP, Group, exp_m1};
use crate::error::{Error, Result};
use crate::interrupt;
use crate::rng::{JotRandom, RowStream, UNIFORMS, check_size};

/// The maximum threshold. The sum for P(b = 0) has as many terms, so bits are faster beyond it.
const MAX_PHOTONS: u32 = 64;

/// The maximum rate in the sum for P(b = 0), which is 0 beyond it.
const MAX_RATE: f64 = 709.0;

/// The maximum number of trials that one random number decides. More trials are drawn in parts, so
/// that no probability of a part is below 2⁻⁶⁴.
const TRIALS_PER_PART: usize = 64;

/// The number of groups of pixels that take the random numbers of one computation.
const GROUPS: usize = UNIFORMS / ELEMENTS_PER_GROUP;

/// Return whether [`draw_counts`] supports a sensor: all jots of a pixel must have the same rate.
pub(crate) fn can_draw_counts(sensor: &Sensor<'_>) -> bool {
    sensor.has_uniform_pixels() && sensor.threshold.photons() <= MAX_PHOTONS
}

/// Draw the counts of all pixels of an image from `frames` frames into `out` `(H, W)`.
///
/// The counts have the distribution of the sums of bits, but other random numbers. Different
/// numbers `index` lead to independent counts.
///
/// # Errors
/// [`Error::Shape`] if the shapes do not match. [`Error::Range`] for a sensor with a smooth kernel,
/// maps, dead jots, or a threshold above 64 photons, for a parameter of the sensor or an intensity
/// that is infinite, NaN, or negative, and if the counts or the index are too large.
pub fn draw_counts(
    sensor: &Sensor<'_>,
    frames: usize,
    image: Image<'_>,
    seed: [u8; 32],
    index: usize,
    mut out: ArrayViewMut2<'_, i32>,
) -> Result<()> {
    sensor.check(&image)?;
    if out.dim() != image.shape() {
        return Err(Error::shape("out", image.shape(), out.dim()));
    }
    let (PerJot::Same(efficiency), PerJot::Same(dark_counts), true) = (
        sensor.efficiency,
        sensor.dark_counts,
        can_draw_counts(sensor),
    ) else {
        let expected = "a box kernel, no maps, no dead jots, and a threshold of at most 64";
        return Err(Error::range("sensor", expected, "another sensor"));
    };
    sensor.check_values(&image, 0..sensor.jots(&image)?.0)?;
    let trials = trials(frames, sensor.kernel.oversampling())? as usize;
    check_size(0, index, trials.div_ceil(TRIALS_PER_PART))?;
    let tap = sensor.kernel.taps()[0];
    let factor = efficiency * sensor.gain_per_frame * tap * tap;
    let columns = out.ncols();
    let mut rates = vec![0.0; out.len()];
    for (row, rates) in rates.chunks_exact_mut(columns).enumerate() {
        match image {
            Image::F32(image) => convert(factor, dark_counts, &contiguous(image.row(row)), rates),
            Image::F64(image) => convert(factor, dark_counts, &contiguous(image.row(row)), rates),
        }
    }
    let counts = CountSampler {
        photons: sensor.threshold.photons(),
        index,
        trials,
    }
    .draw(&rates, seed);
    for (out, count) in out.iter_mut().zip(counts) {
        *out = count;
    }
    Ok(())
}

struct CountSampler {
    /// The threshold q.
    photons: u32,
    index: usize,
    /// The number K.
    trials: usize,
}

impl CountSampler {
    /// Return the counts of pixels. They are incomplete if the call is interrupted.
    fn draw(&self, rates: &[f64], seed: [u8; 32]) -> Vec<i32> {
        let mut random = JotRandom::new(seed);
        let mut counts = vec![0; rates.len()];
        let chunks = rates.chunks(UNIFORMS).zip(counts.chunks_mut(UNIFORMS));
        for (chunk, (rates, counts)) in chunks.enumerate() {
            let mut probabilities = [Probabilities::default(); GROUPS];
            compute(self.photons, rates, &mut probabilities);
            if interrupt::is_requested() {
                break;
            }
            let mut rest = self.trials;
            for part in 0..self.trials.div_ceil(TRIALS_PER_PART) {
                let trials = rest.min(TRIALS_PER_PART);
                rest -= trials;
                let stream = RowStream::new(0, self.index, part);
                let uniforms = random.uniforms(stream, chunk);
                cpu::run(Binomials {
                    trials,
                    ratios: ratios(trials),
                    probabilities: &probabilities,
                    uniforms: &uniforms,
                    counts: &mut *counts,
                });
            }
        }
        counts
    }
}

/// The probabilities of a group of pixels. Each is accurate even if it is tiny.
#[derive(Clone, Copy, Default)]
struct Probabilities {
    /// P(b = 1).
    one: Group,
    /// P(b = 0).
    zero: Group,
}

levels! {
    /// Compute the probabilities of pixels with the threshold `photons`.
    fn compute(
        photons: u32, rates: &[f64], probabilities: &mut [Probabilities; GROUPS],
    ) = compute_inlined;
}

#[inline(always)]
fn compute_inlined(photons: u32, rates: &[f64], probabilities: &mut [Probabilities; GROUPS]) {
    let groups = rates.chunks(ELEMENTS_PER_GROUP);
    for (rates, probabilities) in groups.zip(probabilities) {
        let mut group = [0.0; ELEMENTS_PER_GROUP];
        group[..rates.len()].copy_from_slice(rates);
        let exp_m1 = exp_m1(&group);
        // P(b = 0) = e⁻ˢ Σ sᵏ/k! over k < q, and P(b = 1) is 1 minus it. For q = 1, that difference
        // is (eˢ − 1) e⁻ˢ, which does not cancel. For a larger q, the difference loses digits of a
        // tiny P(b = 1), but its absolute error remains below 10⁻¹⁴.
        let (mut sum, mut term) = ([1.0; ELEMENTS_PER_GROUP], [1.0; ELEMENTS_PER_GROUP]);
        for k in 1..photons {
            for lane in 0..ELEMENTS_PER_GROUP {
                term[lane] *= group[lane].min(MAX_RATE) / f64::from(k);
                sum[lane] += term[lane];
            }
        }
        for lane in 0..ELEMENTS_PER_GROUP {
            let scale = 1.0 / (exp_m1[lane] + 1.0);
            let zero = (sum[lane] * scale).min(1.0);
            let one = if photons == 1 {
                exp_m1[lane] * scale
            } else {
                1.0 - zero
            };
            (probabilities.zero[lane], probabilities.one[lane]) = (zero, one);
        }
    }
}

/// The factors from a term of the binomial distribution to the next one, without the odds.
fn ratios(trials: usize) -> [f64; TRIALS_PER_PART] {
    let mut ratios = [0.0; TRIALS_PER_PART];
    for (rare, ratio) in ratios.iter_mut().take(trials).enumerate() {
        *ratio = (trials - rare) as f64 / (rare + 1) as f64;
    }
    ratios
}

/// The addition of random numbers with the distribution Binomial(`trials`, P(b = 1)) to `counts`.
struct Binomials<'a> {
    trials: usize,
    /// The [`ratios`] of `trials`.
    ratios: [f64; TRIALS_PER_PART],
    probabilities: &'a [Probabilities; GROUPS],
    uniforms: &'a [u64; UNIFORMS],
    counts: &'a mut [i32],
}

impl WithSimd for Binomials<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let uniforms = self.uniforms.as_chunks::<ELEMENTS_PER_GROUP>().0;
        let groups = self.counts.chunks_mut(ELEMENTS_PER_GROUP);
        for ((counts, uniforms), probabilities) in groups.zip(uniforms).zip(self.probabilities) {
            let group = binomial(simd, &self.ratios[..self.trials], probabilities, uniforms);
            for (count, value) in counts.iter_mut().zip(group) {
                *count += value as i32;
            }
        }
    }
}

/// Return the numbers of ones of up to [`TRIALS_PER_PART`] trials: the quantiles of the binomial
/// distribution at the uniform random numbers.
#[inline(always)]
fn binomial<S: Simd>(
    simd: S,
    ratios: &[f64],
    probabilities: &Probabilities,
    uniforms: &[u64; ELEMENTS_PER_GROUP],
) -> Group {
    const LANES: usize = ELEMENTS_PER_GROUP;
    // The rarer outcome is counted, so the sum begins with a probability of at least 2⁻⁶⁴.
    let (mut odds, mut power, mut term) = ([0.0; LANES], [0.0; LANES], [1.0; LANES]);
    let mut uniform = [0.0; LANES];
    for lane in 0..LANES {
        let (one, zero) = (probabilities.one[lane], probabilities.zero[lane]);
        let (rare, frequent) = if one > zero { (zero, one) } else { (one, zero) };
        odds[lane] = rare / frequent;
        power[lane] = frequent;
        // A number in [1, 2) with 52 random bits, minus 1, in the middle of its interval.
        let bits = uniforms[lane] >> 12 | 1f64.to_bits();
        uniform[lane] = f64::from_bits(bits) - (1.0 - 0.5 * f64::EPSILON);
    }
    let trials = ratios.len();
    let mut exponent = trials;
    while exponent > 0 {
        for lane in 0..LANES {
            if exponent % 2 == 1 {
                term[lane] *= power[lane];
            }
            power[lane] *= power[lane];
        }
        exponent /= 2;
    }
    let mut count = rare_outcomes(simd, ratios, &odds, &term, &uniform);
    for lane in 0..LANES {
        if probabilities.one[lane] > probabilities.zero[lane] {
            count[lane] = trials as f64 - count[lane];
        }
    }
    count
}

/// Return how many of the first values of the distribution function are at most `uniform`. The
/// first term of the distribution is `term`.
#[inline(always)]
fn rare_outcomes<S: Simd>(
    simd: S,
    ratios: &[f64],
    odds: &Group,
    term: &Group,
    uniform: &Group,
) -> Group {
    let mut counts = [0.0; ELEMENTS_PER_GROUP];
    let [odds, terms, uniform] = [odds, term, uniform].map(|values| S::as_simd_f64s(values).0);
    let outs = S::as_mut_simd_f64s(&mut counts).0;
    let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
    for (index, out) in outs.iter_mut().enumerate() {
        let (mut sum, mut term, mut count) = (zero, terms[index], zero);
        for &ratio in ratios {
            let ratio = simd.splat_f64s(ratio);
            sum = simd.add_f64s(sum, term);
            let is_above = simd.greater_than_or_equal_f64s(uniform[index], sum);
            count = simd.add_f64s(count, simd.select_f64s(is_above, one, zero));
            term = simd.mul_f64s(term, simd.mul_f64s(ratio, odds[index]));
        }
        *out = count;
    }
    counts
}
