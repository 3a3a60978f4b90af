//! Comparisons of the network with a forward pass in plain loops.

use jotlight::bits::PackedBits;
use jotlight::error::{Error, Result};
use jotlight::network::{
    Layer, Wiring, forward, forward_bits, forward_counts, forward_planes, forward_tied_bits,
    masked_sums,
};
use ndarray::{Array, Array2, Array3, Array4, ArrayView3, Dimension, s};

use crate::random::Random;

const START: f64 = -5.0;
const COEFFICIENTS: usize = 9;
const SPACING: f64 = 10.0 / (COEFFICIENTS - 3) as f64;

impl Random {
    fn layer(&mut self, shape: (usize, usize, usize, usize), wiring: Wiring) -> Result<Layer<f64>> {
        let scale = 2.0 / ((shape.1 * shape.2 * shape.3) as f64).sqrt();
        let filters = Array4::from_shape_simple_fn(shape, || scale * (self.fraction() - 0.5));
        let channels = shape.0 / (wiring.upsampling * wiring.upsampling);
        let coefficients = Array2::from_shape_simple_fn((channels, COEFFICIENTS), || {
            4.0 * (self.fraction() - 0.5)
        });
        Layer::new(filters, Some(coefficients.view()), START, SPACING, wiring)
    }
}

/// Return the index of the element that continues an axis symmetrically at `index`.
fn mirrored(index: isize, size: usize) -> usize {
    let period = 2 * size as isize;
    let index = index.rem_euclid(period);
    index.min(period - 1 - index) as usize
}

/// Return h * u with a stride by its definition, equation (9).
fn convolved(layer: &Layer<f64>, planes: ArrayView3<'_, f64>, stride: usize) -> Array3<f64> {
    let (outputs, inputs, rows, columns) = layer.filters().dim();
    let (_, height, width) = planes.dim();
    let shape = (outputs, height / stride, width / stride);
    Array3::from_shape_fn(shape, |(output, m, n)| {
        let mut sum = 0.0;
        for (input, i, j) in ndarray::indices((inputs, rows, columns)) {
            let position = |index: usize, tap: usize, taps: usize| {
                (index * stride + taps - 1 - tap) as isize - ((taps - stride) / 2) as isize
            };
            let y = mirrored(position(m, i, rows), height);
            let x = mirrored(position(n, j, columns), width);
            sum += layer.filters()[[output, input, i, j]] * planes[[input, y, x]];
        }
        sum
    })
}

/// Return the output of a network by its definition. The strides must divide the image size.
fn naive_forward(layers: &[Layer<f64>], wiring: &[Wiring], sums: &Array3<f64>) -> Array3<f64> {
    let mut planes: Vec<Array3<f64>> = Vec::new();
    for (index, (layer, wiring)) in layers.iter().zip(wiring).enumerate() {
        let mut output = sums.clone();
        if index > 0 {
            let input = &planes[wiring.input.unwrap_or(index - 1)];
            let deep = convolved(layer, input.view(), wiring.stride);
            let (_, rows, columns) = deep.dim();
            let r = wiring.upsampling;
            let shape = (layer.channels(), rows * r, columns * r);
            output = Array3::from_shape_fn(shape, |(channel, y, x)| {
                deep[[(channel * r + y % r) * r + x % r, y / r, x / r]]
            });
        }
        if let Some(skip) = wiring.skip {
            output += &planes[skip];
        }
        for (spline, mut plane) in layer.splines().iter().zip(output.outer_iter_mut()) {
            plane.mapv_inplace(|z| spline.value(z));
        }
        planes.push(output);
    }
    planes.swap_remove(planes.len() - 1)
}

fn wiring(stride: usize, upsampling: usize, input: Option<usize>, skip: Option<usize>) -> Wiring {
    Wiring {
        stride,
        upsampling,
        input,
        skip,
    }
}

/// Return layers with strides, upsampling, and skip connections. One uses Winograd convolution.
fn connected_layers(random: &mut Random) -> Result<(Vec<Layer<f64>>, Vec<Wiring>)> {
    let layers = [
        ((3, 1, 1, 1), Wiring::default()),
        ((16, 3, 4, 2), wiring(2, 1, None, None)),
        ((8, 16, 3, 3), wiring(1, 1, None, None)),
        ((8, 8, 3, 3), wiring(3, 1, None, None)),
        ((72, 8, 1, 1), wiring(1, 3, None, Some(2))),
        ((4, 8, 1, 3), wiring(1, 2, None, None)),
        ((1, 3, 5, 4), wiring(1, 1, Some(0), Some(5))),
    ];
    let built: Result<Vec<_>> = layers
        .iter()
        .map(|&(shape, wiring)| random.layer(shape, wiring))
        .collect();
    Ok((built?, layers.map(|(_, wiring)| wiring).to_vec()))
}

/// Return layers whose Winograd convolutions have skip connections and upsampling. The last one has
/// three channels.
fn winograd_layers(random: &mut Random) -> Result<(Vec<Layer<f64>>, Vec<Wiring>)> {
    let layers = [
        ((3, 1, 1, 1), Wiring::default()),
        ((17, 3, 6, 6), wiring(2, 1, None, None)),
        ((17, 17, 3, 3), wiring(1, 1, None, Some(1))),
        ((26, 17, 3, 3), wiring(1, 1, None, None)),
        ((12, 26, 3, 3), wiring(1, 2, None, Some(0))),
        ((3, 3, 3, 3), wiring(1, 1, None, None)),
    ];
    let built: Result<Vec<_>> = layers
        .iter()
        .map(|&(shape, wiring)| random.layer(shape, wiring))
        .collect();
    Ok((built?, layers.map(|(_, wiring)| wiring).to_vec()))
}

fn largest_difference<D: Dimension>(a: &Array<f64, D>, b: &Array<f64, D>) -> f64 {
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, f64::max)
}

#[test]
fn the_forward_pass_agrees_with_its_definition() -> Result<()> {
    let mut random = Random(1);
    for (layers, wiring) in [
        connected_layers(&mut random)?,
        winograd_layers(&mut random)?,
    ] {
        let references: Vec<&Layer<f64>> = layers.iter().collect();
        for (height, width) in [(6, 6), (24, 66), (48, 6), (12, 1098)] {
            let sums = Array3::from_shape_simple_fn((3, height, width), || {
                8.0 * (random.fraction() - 0.5)
            });
            let expected = naive_forward(&layers, &wiring, &sums);
            let mut found = Array3::zeros(expected.raw_dim());
            forward_planes(&references, sums.view(), found.view_mut())?;
            assert!(largest_difference(&found, &expected) < 1e-9);
        }
    }
    Ok(())
}

#[test]
fn images_of_any_size_have_a_forward_pass() -> Result<()> {
    let mut random = Random(2);
    let (layers, _) = winograd_layers(&mut random)?;
    let references: Vec<&Layer<f64>> = layers.iter().collect();
    for size in [(1, 1), (1, 9), (7, 1), (3, 5), (5, 3), (33, 131)] {
        let sums = Array3::from_shape_simple_fn((3, size.0, size.1), || random.fraction() - 0.5);
        let mut found = Array3::from_elem((3, size.0, size.1), f64::NAN);
        forward_planes(&references, sums.view(), found.view_mut())?;
        assert!(found.iter().all(|value| value.is_finite()));
    }
    Ok(())
}

#[test]
fn counts_bits_and_sums_lead_to_the_same_image() -> Result<()> {
    let mut random = Random(3);
    for (frames, side) in [(1, 2), (2, 3), (1, 4), (3, 8)] {
        let trials = frames * side * side;
        let (height, width) = (40, 19);
        let tap = (random.fraction() - 0.5) / side as f64;
        let filters = Array4::from_elem((1, frames, side, side), tap);
        let coefficients =
            Array2::from_shape_simple_fn((1, COEFFICIENTS), || random.fraction() - 0.5);
        let first = |filters| {
            let wiring = Wiring::default();
            Layer::new(filters, Some(coefficients.view()), START, SPACING, wiring)
        };
        let weighted = first(filters)?;
        let tied = first(Array4::from_elem((1, 1, 1, 1), tap))?;
        let second = random.layer((1, 1, 3, 3), Wiring::default())?;

        let bytes = (width * side).div_ceil(8);
        let packed = Array3::from_shape_simple_fn((frames, height * side, bytes), || {
            (random.fraction() * 255.0) as u8
        });
        let bits = PackedBits::new(packed.view(), width * side)?;
        let mut counts = Array2::zeros((height, width));
        jotlight::bits::add_block_counts(&bits, side, None, counts.view_mut())?;
        let by_count = Array2::from_shape_fn((1, trials + 1), |(_, k)| tap * k as f64);
        let valid = Array2::from_elem((height * side, bytes), 255);
        let sums = masked_sums(&weighted, &bits, valid.view())?;

        let (two, by_count) = ([&tied, &second], by_count.view());
        let mut found = [0; 4].map(|_| Array2::from_elem((height, width), f64::NAN));
        let [from_bits, from_counts, from_sums, from_tied_bits] = &mut found;
        forward_bits(&[&weighted, &second], &bits, from_bits.view_mut())?;
        forward_counts(&two, counts.view(), by_count, from_counts.view_mut())?;
        forward(&two, sums.view(), from_sums.view_mut())?;
        forward_tied_bits(&two, &bits, side, by_count, from_tied_bits.view_mut())?;
        assert!(largest_difference(from_bits, from_counts) < 1e-12);
        assert!(largest_difference(from_bits, from_sums) < 1e-12);
        assert_eq!(from_tied_bits, from_counts);
    }
    Ok(())
}

#[test]
fn counts_without_a_sum_are_refused() -> Result<()> {
    let layer = Random(4).layer((1, 1, 1, 1), Wiring::default())?;
    for count in [-1, 3] {
        let counts = Array2::from_elem((2, 2), count);
        let (sums, mut out) = (Array2::zeros((1, 3)), Array2::zeros((2, 2)));
        let result = forward_counts(&[&layer], counts.view(), sums.view(), out.view_mut());
        assert!(matches!(result, Err(Error::Range { what: "counts", .. })));
    }
    Ok(())
}

#[test]
fn layers_that_do_not_match_are_refused() -> Result<()> {
    let mut random = Random(5);
    let (sums, mut out) = (Array3::zeros((1, 4, 4)), Array2::zeros((4, 4)));
    let first = random.layer((1, 1, 1, 1), Wiring::default())?;
    let of_size = "output of the last layer: expected planes of the size of the image, \
                   got another size";
    for (shape, wiring, expected) in [
        ((1, 2, 1, 1), Wiring::default(), "input channels of a layer"),
        (
            (2, 1, 1, 1),
            Wiring::default(),
            "output channels of the last",
        ),
        ((1, 1, 2, 2), wiring(2, 1, None, None), of_size),
        ((4, 1, 1, 1), wiring(1, 2, None, None), of_size),
        ((1, 1, 1, 1), wiring(1, 1, Some(1), None), "input or skip"),
        ((1, 1, 1, 1), wiring(1, 1, None, Some(1)), "input or skip"),
    ] {
        let second = random.layer(shape, wiring)?;
        let message = forward(&[&first, &second], sums.view(), out.view_mut())
            .map_or_else(|error| error.to_string(), |()| String::new());
        assert!(message.starts_with(expected), "{message}");
    }
    assert!(forward::<f64>(&[], sums.view(), out.view_mut()).is_err());
    Ok(())
}

#[test]
fn images_that_cannot_be_written_are_refused() -> Result<()> {
    let layer = Random(7).layer((1, 1, 1, 1), Wiring::default())?;
    let sums = Array3::zeros((1, 4, 6));
    let mut planes = Array3::zeros((3, 4, 6));
    let result = forward_planes(&[&layer], sums.view(), planes.view_mut());
    assert!(matches!(result, Err(Error::Shape { what: "out", .. })));
    let mut image = Array2::zeros((8, 6));
    for (end, step) in [(3, 1), (8, 2)] {
        let out = image.slice_mut(s![..end; step, ..]);
        let result = forward(&[&layer], sums.view(), out);
        assert!(matches!(result, Err(Error::Shape { what: "out", .. })));
    }
    Ok(())
}

/// Tied networks count bits in regions, whose first column need not begin with a byte.
#[test]
fn counts_of_regions_are_those_of_the_image() -> Result<()> {
    let mut random = Random(8);
    let layers = [
        random.layer((1, 1, 1, 1), Wiring::default())?,
        random.layer((1, 1, 7, 7), Wiring::default())?,
    ];
    let layers = layers.each_ref();
    for (frames, side, width) in [(1, 4, 1100), (1, 3, 1037), (40, 1, 2100), (17, 2, 1030)] {
        let (height, jots): (_, usize) = (9, width * side);
        let shape = (frames, height * side, jots.div_ceil(8));
        let packed = Array3::from_shape_simple_fn(shape, || (random.fraction() * 255.0) as u8);
        let bits = PackedBits::new(packed.view(), jots)?;
        let mut counts = Array2::zeros((height, width));
        jotlight::bits::add_block_counts(&bits, side, None, counts.view_mut())?;
        let trials = frames * side * side;
        let sums = Array2::from_shape_fn((1, trials + 1), |(_, k)| k as f64 / trials as f64);
        let mut found = [0; 2].map(|_| Array2::zeros((height, width)));
        let [from_counts, from_bits] = &mut found;
        forward_counts(&layers, counts.view(), sums.view(), from_counts.view_mut())?;
        forward_tied_bits(&layers, &bits, side, sums.view(), from_bits.view_mut())?;
        assert_eq!(from_counts, from_bits);
    }
    Ok(())
}
