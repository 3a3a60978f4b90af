//! Comparisons with sums of products in 64 bits, by emulated tiles and by those of the processor.

use std::ops::Range;

use ndarray::{Array2, Array3, Array4, s};

use super::amx::Amx;
use super::block::TileWorkspace;
use super::*;
use crate::network::convolution::filter_taps::FilterTaps;
use crate::network::convolution::padded::Padded;
use crate::network::precision::{round, round_filters};
use crate::network::spline::channels::build_splines;
use crate::network::spline::evaluate::Spline;
use crate::network::tiling::strips::{RowLayout, Strip};

/// Tiles in memory, and the arithmetic of the processor's manual.
struct Emulated {
    shape: TileShape,
    words: [[[u32; SIDE]; SIDE]; 8],
}

impl TileUnit for Emulated {
    fn configured(shape: TileShape) -> Self {
        let words = [[[0; SIDE]; SIDE]; 8];
        Self { shape, words }
    }

    fn load_filters<const TILE: usize>(&mut self, lines: &[Line]) {
        for row in 0..self.shape.outputs {
            self.words[TILE][row] = lines[row].0;
        }
    }

    fn load_planes<const TILE: usize>(&mut self, source: &[u32], stride: usize) {
        for row in 0..self.shape.pairs {
            self.words[TILE][row].copy_from_slice(&source[row * stride..][..SIDE]);
        }
    }

    fn zero<const TILE: usize>(&mut self) {
        self.words[TILE] = [[0; SIDE]; SIDE];
    }

    fn multiply<const SUMS: usize, const FILTERS: usize, const PLANES: usize>(&mut self) {
        let first = |word: u32| f32::from_bits(word << 16);
        let second = |word: u32| f32::from_bits(word & 0xffff_0000);
        for output in 0..self.shape.outputs {
            for column in 0..SIDE {
                let mut sums = (0f32, 0f32);
                for pair in 0..self.shape.pairs {
                    let filter = self.words[FILTERS][output][pair];
                    let plane = self.words[PLANES][pair][column];
                    sums.0 = first(filter).mul_add(first(plane), sums.0);
                    sums.1 = second(filter).mul_add(second(plane), sums.1);
                }
                let word = &mut self.words[SUMS][output][column];
                *word = (f32::from_bits(*word) + (sums.0 + sums.1)).to_bits();
            }
        }
    }

    fn store<const TILE: usize>(&self, out: &mut [f32], stride: usize) {
        for row in 0..self.shape.outputs {
            let words = self.words[TILE][row].map(f32::from_bits);
            out[row * stride..][..SIDE].copy_from_slice(&words);
        }
    }
}

/// Return pseudorandom values in \[−0.5, 0.5\], rounded to bfloat16, from a linear congruential
/// generator.
fn random(seed: u32, length: usize) -> Vec<f32> {
    let next = |state: &u32| Some(state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let states = std::iter::successors(Some(seed), next).skip(3);
    let values = states.map(|state| round(state as f32 / u32::MAX as f32 - 0.5));
    values.take(length).collect()
}

fn random_planes(seed: u32, (planes, height, width): (usize, usize, usize)) -> Array3<f32> {
    let values = random(seed, planes * height * width).into_iter();
    let mut planes = Array3::zeros((planes, height, width));
    planes
        .iter_mut()
        .zip(values)
        .for_each(|(to, from)| *to = from);
    planes
}

fn random_filters(outputs: usize, inputs: usize) -> Array4<f32> {
    let mut values = random(7, outputs * inputs * 9).into_iter();
    // Outputs of order 1, as in trained networks.
    let scale = 2.0 / (inputs as f32).sqrt() / 3.0;
    let mut filters = Array4::zeros((outputs, inputs, 3, 3));
    filters.mapv_inplace(|_: f32| scale * values.next().unwrap_or(0.0));
    round_filters(&mut filters);
    filters
}

/// A layer: filters, the factor of the upsampling, planes that are added, and splines.
struct Example {
    planes: Array3<f32>,
    filters: Array4<f32>,
    upsampling: usize,
    skip: Option<Array3<f32>>,
    splines: Vec<Spline<f32>>,
}

impl Example {
    fn new(
        (outputs, inputs): (usize, usize),
        (height, width): (usize, usize),
        upsampling: usize,
        is_finished: bool,
    ) -> Result<Self, crate::error::Error> {
        let channels = outputs / (upsampling * upsampling);
        let size = (channels, height * upsampling, width * upsampling);
        let mut coefficients = Array2::zeros((channels, 13));
        let values = random(3, 13 * channels);
        coefficients
            .iter_mut()
            .zip(values)
            .for_each(|(to, from)| *to = from);
        let splines = build_splines(coefficients.view(), -3.0, 0.6)?;
        Ok(Self {
            planes: random_planes(1, (inputs, height, width)),
            filters: random_filters(outputs, inputs),
            upsampling,
            skip: is_finished.then(|| random_planes(2, size)),
            splines: if is_finished { splines } else { Vec::new() },
        })
    }

    /// Return the output for a region, by tiles.
    fn output<U: TileUnit, const ROUNDS: bool>(&self, region: &Region) -> Array3<f32> {
        let filtered = region.before_upsampling(self.upsampling);
        // Only the columns that the filters read are in memory.
        let width = self.planes.dim().2;
        let columns = &filtered.columns;
        let columns = columns.start.saturating_sub(1)..(columns.end + 1).min(width);
        let source = Stored::new(&self.planes, columns);
        let skip = self.skip.as_ref();
        let skip = skip.map(|skip| Stored::new(skip, 0..skip.dim().2));
        let skip = skip.as_ref().map(Stored::view);
        let filters = TileFilters::pack(self.filters.view());
        let channels = self.filters.dim().0 / (self.upsampling * self.upsampling);
        let layout = RowLayout::new(region.columns.clone(), channels);
        let rows = region.rows.clone();
        let data = vec![f32::NAN; layout.length(rows.len())];
        let mut strip = Strip { rows, data };
        let mut out = layout.planes_mut(&mut strip);
        let finish = Finish::<'_, f32, ROUNDS> {
            upsampling: self.upsampling,
            skip: skip.as_ref(),
            splines: &self.splines,
            region,
        };
        let workspace = &mut TileWorkspace::default();
        filters.convolve_with::<U, f32, ROUNDS>(
            &source.view(),
            &filtered,
            &finish,
            workspace,
            &mut out,
        );
        let shape = (channels, region.rows.len(), region.columns.len());
        Array3::from_shape_fn(shape, |(plane, row, column)| out.row(plane, row)[column])
    }

    /// Return the output for all pixels by sums in 64 bits.
    fn expected(&self) -> Array3<f64> {
        let taps = FilterTaps::new(self.filters.mapv(f64::from).view(), 1);
        let sums = Padded::mirrored(self.planes.mapv(f64::from).view(), &taps).convolved(&taps);
        let factor = self.upsampling;
        let (outputs, height, width) = sums.dim();
        let shape = (outputs / factor / factor, height * factor, width * factor);
        Array3::from_shape_fn(shape, |(channel, row, column)| {
            let phase = (channel * factor + row % factor) * factor + column % factor;
            let skip = self.skip.as_ref();
            let skip = skip.map_or(0.0, |skip| f64::from(skip[[channel, row, column]]));
            let sum = sums[[phase, row / factor, column / factor]] + skip;
            let spline = self.splines.get(channel);
            spline.map_or(sum, |spline| f64::from(spline.value(sum as f32)))
        })
    }
}

/// Planes in the memory layout of layers.
struct Stored {
    strips: [Strip<Vec<f32>>; 1],
    layout: RowLayout,
    size: (usize, usize),
}

impl Stored {
    fn new(planes: &Array3<f32>, columns: Range<usize>) -> Self {
        let (channels, height, width) = planes.dim();
        let layout = RowLayout::new(columns.clone(), channels);
        // The values around the rows have no meaning.
        let data = vec![f32::NAN; layout.length(height)];
        let mut strip = Strip {
            rows: 0..height,
            data,
        };
        let mut memory = layout.planes_mut(&mut strip);
        let known = planes.slice(s![.., .., columns]);
        for ((plane, row, column), &value) in known.indexed_iter() {
            memory.row(plane, row)[column] = value;
        }
        Self {
            strips: [strip],
            layout,
            size: (height, width),
        }
    }

    fn view(&self) -> StripedPlanes<'_, f32> {
        StripedPlanes::new(&self.strips, &self.layout, self.size)
    }
}

fn whole(example: &Example) -> Region {
    let (_, height, width) = example.planes.dim();
    Region::whole((height * example.upsampling, width * example.upsampling))
}

#[test]
fn outputs_are_sums_of_products_and_do_not_depend_on_the_region() -> crate::error::Result<()> {
    for size in [(1, 1), (2, 17), (3, 5), (9, 40), (7, 101)] {
        for channels in [
            (4, 12),
            (5, 17),
            (12, 12),
            (24, 24),
            (40, 40),
            (52, 33),
            (80, 80),
        ] {
            let example = Example::new(channels, size, 1, false)?;
            let all = example.output::<Emulated, false>(&whole(&example));
            for (value, expected) in all.iter().zip(&example.expected()) {
                assert!((f64::from(*value) - expected).abs() < 2e-6, "{size:?}");
            }
            let part = Region {
                rows: size.0 / 3..size.0,
                columns: size.1 / 2..(size.1 - size.1 / 5).max(size.1 / 2 + 1),
            };
            let found = example.output::<Emulated, false>(&part);
            let expected = all.slice(s![.., part.rows.clone(), part.columns.clone()]);
            assert!(expected.iter().eq(found.iter()), "{size:?} {channels:?}");
        }
    }
    Ok(())
}

#[test]
fn skips_splines_and_upsampling_follow() -> crate::error::Result<()> {
    for (channels, upsampling) in [((24, 24), 1), ((4, 24), 2), ((36, 12), 3), ((48, 40), 2)] {
        for size in [(1, 1), (6, 33), (9, 70)] {
            let example = Example::new(channels, size, upsampling, true)?;
            let region = whole(&example);
            let plain = example.output::<Emulated, false>(&region);
            for (value, expected) in plain.iter().zip(&example.expected()) {
                assert!((f64::from(*value) - expected).abs() < 5e-6);
            }
            let rounded = example.output::<Emulated, true>(&region);
            assert!(plain.iter().map(|&x| round(x)).eq(rounded.iter().copied()));
        }
    }
    Ok(())
}

#[test]
fn tiles_of_the_processor_return_what_the_emulated_ones_return() -> crate::error::Result<()> {
    println!("AMX is available: {}", Amx::is_available());
    if !Amx::is_available() {
        return Ok(());
    }
    for size in [(1, 1), (9, 40)] {
        for (channels, upsampling) in [((12, 12), 1), ((24, 24), 1), ((4, 40), 2), ((52, 33), 1)] {
            let example = Example::new(channels, size, upsampling, true)?;
            let region = whole(&example);
            let expected = example.output::<Emulated, true>(&region);
            assert_eq!(example.output::<Amx, true>(&region), expected);
        }
    }
    Ok(())
}

#[test]
fn filters_without_tiles_have_none() {
    for (shape, stride) in [((12, 12, 3, 3), 2), ((12, 12, 1, 1), 1), ((12, 4, 3, 3), 1)] {
        assert!(TileFilters::new(Array4::<f32>::zeros(shape).view(), stride).is_none());
    }
}
