//! The evaluation of a layer on one strip of a tile, and the buffers for it.

use std::ops::Range;

use super::region::Region;
use super::strips::StripedPlanes;
use crate::cpu::levels;
use crate::network::convolution::padded::Padded;
use crate::network::convolution::winograd::Finish;
use crate::network::layer::Layer;
use crate::numbers::Real;
use crate::sensing::mirror_index;

/// The buffers for the evaluation of a strip.
#[derive(Default)]
pub(super) struct StripWorkspace<F> {
    padded: Padded<F>,
    winograd: Vec<F>,
    /// The planes before the depth-to-space rearrangement.
    deep: Vec<F>,
}

impl<F: Real> StripWorkspace<F> {
    /// Write a region of a layer's output into `out`: convolve, rearrange, add the skip connection,
    /// and apply the splines.
    pub fn compute(
        &mut self,
        layer: &Layer<F>,
        input: &StripedPlanes<'_, F>,
        skip: Option<&StripedPlanes<'_, F>>,
        region: &Region,
        out: &mut [F],
    ) {
        let upsampling = layer.wiring.upsampling;
        let filtered = region.before_upsampling(upsampling);
        if let Some(winograd) = layer.winograd() {
            let finish = Finish {
                upsampling,
                skip,
                splines: layer.splines(),
                region,
            };
            winograd.convolve(input, &filtered, &finish, &mut self.winograd, out);
            return;
        }
        let Self { padded, deep, .. } = self;
        let mut convolve = |out: &mut [F]| {
            padded.fill(input, &filtered, layer.filter_taps());
            padded.convolve(layer.filter_taps(), out);
        };
        if upsampling == 1 {
            convolve(out);
        } else {
            deep.resize(deep.len().max(out.len()), F::zero());
            let deep = &mut deep[..out.len()];
            convolve(deep);
            let size = (filtered.rows.len(), filtered.columns.len());
            depth_to_space(deep, upsampling, size, out);
        }
        if let Some(skip) = skip {
            add_skip(skip, region, out);
        }
        layer.activate(out);
    }

    /// Write a region of the first layer's output into `out`. The output continues symmetrically
    /// beyond the last row and the last column of the image.
    pub fn mirror_first_layer(
        &mut self,
        first_layer: impl Fn(&Region, &mut [F]),
        size: (usize, usize),
        channels: usize,
        region: &Region,
        out: &mut [F],
    ) {
        if region.rows.end <= size.0 && region.columns.end <= size.1 {
            return first_layer(region, out);
        }
        let inside = |range: &Range<usize>, size: usize| {
            let beyond = range.end.saturating_sub(size);
            range.start.min(size.saturating_sub(beyond.max(1)))..range.end.min(size)
        };
        let source_region = Region {
            rows: inside(&region.rows, size.0),
            columns: inside(&region.columns, size.1),
        };
        let planes = self.padded.scratch(channels * source_region.pixels());
        first_layer(&source_region, planes);
        let width = source_region.columns.len();
        let sources = planes.chunks_exact(source_region.pixels());
        for (source, out) in sources.zip(out.chunks_exact_mut(region.pixels())) {
            let rows = out.chunks_exact_mut(region.columns.len());
            for (row, out) in region.rows.clone().zip(rows) {
                let row = mirror_index(row as isize, size.0) - source_region.rows.start;
                for (column, out) in region.columns.clone().zip(out) {
                    let column =
                        mirror_index(column as isize, size.1) - source_region.columns.start;
                    *out = source[row * width + column];
                }
            }
        }
    }
}

/// Rearrange each group of `factor`² planes into one plane with `factor` times as many rows and
/// columns.
fn depth_to_space<F: Real>(
    deep: &[F],
    factor: usize,
    (height, width): (usize, usize),
    out: &mut [F],
) {
    let group = factor * factor * height * width;
    let planes = deep.chunks_exact(group);
    for (deep, out) in planes.zip(out.chunks_exact_mut(group)) {
        for (row, out) in out.chunks_exact_mut(factor * width).enumerate() {
            let phases =
                deep[row % factor * factor * height * width..].chunks_exact(height * width);
            let mut phases = phases.map(|phase| &phase[row / factor * width..][..width]);
            if factor == 2
                && let (Some(even), Some(odd)) = (phases.next(), phases.next())
            {
                interleave(even, odd, out);
                continue;
            }
            for (phase, values) in phases.take(factor).enumerate() {
                let pixels = out.iter_mut().skip(phase).step_by(factor);
                for (out, &value) in pixels.zip(values) {
                    *out = value;
                }
            }
        }
    }
}

levels! {
    /// Write the values of two rows alternately into `out`.
    fn interleave[F: Real](even: &[F], odd: &[F], out: &mut [F]) = interleave_inlined;
}

#[inline(always)]
fn interleave_inlined<F: Real>(even: &[F], odd: &[F], out: &mut [F]) {
    let (pairs, _) = out.as_chunks_mut::<2>();
    for ((pair, &even), &odd) in pairs.iter_mut().zip(even).zip(odd) {
        *pair = [even, odd];
    }
}

/// Add a region of the planes of a skip connection to `out`.
fn add_skip<F: Real>(skip: &StripedPlanes<'_, F>, region: &Region, out: &mut [F]) {
    let left = region.columns.start - skip.columns.start;
    let width = region.columns.len();
    for (plane, out) in out.chunks_exact_mut(region.pixels()).enumerate() {
        for (row, out) in region.rows.clone().zip(out.chunks_exact_mut(width)) {
            let skip = &skip.row(row).plane(plane)[left..][..width];
            for (out, &value) in out.iter_mut().zip(skip) {
                *out += value;
            }
        }
    }
}
