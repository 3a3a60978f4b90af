//! The evaluation of a layer on one strip of a tile, and the buffers for it.

use std::ops::Range;

use super::interleave::interleave;
use super::region::Region;
use super::strips::{PlanesMut, StripedPlanes};
use crate::border::mirror_index;
use crate::cpu::levels;
use crate::network::convolution::padded::Padded;
use crate::network::convolution::tiles::TileWorkspace;
use crate::network::convolution::winograd::Finish;
use crate::network::layer::Layer;
use crate::numbers::Real;

/// The buffers for the evaluation of a strip.
#[derive(Default)]
pub(super) struct StripWorkspace<F> {
    padded: Padded<F>,
    winograd: Vec<F>,
    tiles: TileWorkspace<F>,
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
        out: &mut PlanesMut<'_, F>,
    ) {
        let upsampling = layer.wiring.upsampling;
        let filtered = region.before_upsampling(upsampling);
        let is_done = if layer.rounding.output {
            self.convolve_and_finish::<true>(layer, input, skip, region, out)
        } else {
            self.convolve_and_finish::<false>(layer, input, skip, region, out)
        };
        if is_done {
            return;
        }
        // The values of a single row are still in the cache when the next step reads them.
        let is_pointwise = layer.filter_taps().is_pointwise();
        let group = if is_pointwise { 1 } else { filtered.rows.len() };
        for top in filtered.rows.clone().step_by(group) {
            let part = Region {
                rows: top..(top + group).min(filtered.rows.end),
                columns: filtered.columns.clone(),
            };
            let first = (top - filtered.rows.start) * upsampling;
            let out = &mut out.rows(first, part.rows.len() * upsampling);
            self.convolve(layer, input, &part, out);
            if let Some(skip) = skip {
                let start = (region.rows.start + first, region.columns.start);
                add_skip(skip, start, layer.channels(), out);
            }
            layer.activate(out);
        }
    }

    /// Do all by a convolution that finishes the output, if there is one for the layer. Return whether
    /// there is. The output is rounded if `ROUNDS`.
    fn convolve_and_finish<const ROUNDS: bool>(
        &mut self,
        layer: &Layer<F>,
        input: &StripedPlanes<'_, F>,
        skip: Option<&StripedPlanes<'_, F>>,
        region: &Region,
        out: &mut PlanesMut<'_, F>,
    ) -> bool {
        let upsampling = layer.wiring.upsampling;
        let filtered = region.before_upsampling(upsampling);
        let finish = Finish::<'_, F, ROUNDS> {
            upsampling,
            skip,
            splines: layer.splines(),
            region,
        };
        if let Some(tiles) = layer.tiles() {
            tiles.convolve(input, &filtered, &finish, &mut self.tiles, out);
        } else if let Some(winograd) = layer.winograd() {
            winograd.convolve(input, &filtered, &finish, &mut self.winograd, out);
        } else {
            return false;
        }
        true
    }

    /// Write a region of the filters' output into `out`, after its depth-to-space rearrangement.
    fn convolve(
        &mut self,
        layer: &Layer<F>,
        input: &StripedPlanes<'_, F>,
        filtered: &Region,
        out: &mut PlanesMut<'_, F>,
    ) {
        let (upsampling, taps) = (layer.wiring.upsampling, layer.filter_taps());
        let Self { padded, deep, .. } = self;
        let mut convolve = |out: &mut PlanesMut<'_, F>| {
            if !taps.correlate_row(input, filtered, out) {
                padded.fill(input, filtered, taps);
                padded.convolve(taps, out);
            }
        };
        if upsampling == 1 {
            return convolve(out);
        }
        let length = taps.outputs() * filtered.pixels();
        deep.resize(deep.len().max(length), F::zero());
        let size = (filtered.rows.len(), filtered.columns.len());
        convolve(&mut PlanesMut::contiguous(&mut deep[..length], size));
        depth_to_space(&deep[..length], upsampling, size, out);
    }

    /// Write a region of the first layer's output into `out`. The output continues symmetrically
    /// beyond the last row and the last column of the image.
    pub fn mirror_first_layer(
        &mut self,
        first_layer: impl Fn(&Region, &mut PlanesMut<'_, F>),
        size: (usize, usize),
        channels: usize,
        region: &Region,
        out: &mut PlanesMut<'_, F>,
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
        let (height, width) = (source_region.rows.len(), source_region.columns.len());
        first_layer(
            &source_region,
            &mut PlanesMut::contiguous(planes, (height, width)),
        );
        for (plane, source) in planes.chunks_exact(height * width).enumerate() {
            for (out_row, row) in region.rows.clone().enumerate() {
                let row = mirror_index(row as isize, size.0) - source_region.rows.start;
                let source = &source[row * width..][..width];
                let out = out.row(plane, out_row);
                let first = region.columns.start - source_region.columns.start;
                let (inside, beyond) = out.split_at_mut(width - first);
                inside.copy_from_slice(&source[first..]);
                for (column, out) in (source_region.columns.end..).zip(beyond) {
                    let column = mirror_index(column as isize, size.1);
                    *out = source[column - source_region.columns.start];
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
    out: &mut PlanesMut<'_, F>,
) {
    let pixels = height * width;
    for (plane, deep) in deep.chunks_exact(factor * factor * pixels).enumerate() {
        for row in 0..factor * height {
            let phases = deep[row % factor * factor * pixels..].chunks_exact(pixels);
            let mut phases = phases.map(|phase| &phase[row / factor * width..][..width]);
            let out = out.row(plane, row);
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
    /// Add `values` to `out`.
    fn add[F: Real](values: &[F], out: &mut [F]) = add_inlined;
}

#[inline(always)]
fn add_inlined<F: Real>(values: &[F], out: &mut [F]) {
    for (out, &value) in out.iter_mut().zip(values) {
        *out += value;
    }
}

/// Add the planes of a skip connection to `out`, whose first pixel is `(top, left)`.
fn add_skip<F: Real>(
    skip: &StripedPlanes<'_, F>,
    (top, left): (usize, usize),
    channels: usize,
    out: &mut PlanesMut<'_, F>,
) {
    for row in 0..out.height {
        let skip_row = skip.row(top + row);
        for plane in 0..channels {
            add(
                &skip_row.plane(plane)[left - skip.columns.start..],
                out.row(plane, row),
            );
        }
    }
}
