//! Measurements of the throughput of the hot loops on one thread, for every instruction set of the
//! processor: `cargo bench --manifest-path benchmarks/engine/Cargo.toml`.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use jotlight::bits::{PackedBits, add_block_counts};
use jotlight::cpu::Level;
use jotlight::error::Result;
use jotlight::likelihood::Threshold;
use jotlight::network::{Batch, Layer, Patch, Wiring, forward, forward_bits, forward_counts};
use jotlight::sensing::{Image, Kernel, PerJot, Sensor, Window, expose};
use jotlight::threads::install;
use ndarray::{Array2, Array3, Array4};

const HEIGHT: usize = 321;
const WIDTH: usize = 481;
const PIXELS: usize = HEIGHT * WIDTH;
const SIDE: usize = 4;

/// Measure `work` for every instruction set. One call processes `items` items.
fn at_every_level(c: &mut Criterion, name: &str, items: usize, mut work: impl FnMut() + Send) {
    let mut group = c.benchmark_group(name);
    group.throughput(Throughput::Elements(items as u64));
    for level in Level::supported() {
        let chosen = Level::choose(Some(level.name()));
        assert!(chosen.is_ok(), "{chosen:?}");
        group.bench_function(level.name(), |b| {
            let result = install(Some(1), || b.iter(&mut work));
            assert!(result.is_ok(), "{result:?}");
        });
    }
    group.finish();
}

/// Return a layer with a smooth φ, and with the number of knots of the pretrained networks.
fn layer(filters: Array4<f32>, range: f32) -> Result<Layer<f32>> {
    let shape = (filters.dim().0, 150);
    let coefficients = Array2::from_shape_fn(shape, |(_, k)| (k as f32 / 150.0).sqrt());
    let spacing = range / 147.0;
    let wiring = Wiring::default();
    Layer::new(filters, Some(coefficients.view()), 0.0, spacing, wiring)
}

fn sensor<'a>(side: usize) -> Result<Sensor<'a>> {
    Ok(Sensor {
        kernel: Kernel::new(0, side)?,
        gain_per_frame: (side * side) as f64,
        efficiency: PerJot::Same(1.0),
        dark_counts: PerJot::Same(0.0),
        dead: None,
        threshold: Threshold::new(1)?,
    })
}

/// Return an image of irregular values.
fn image(height: usize, width: usize) -> Array2<f32> {
    Array2::from_shape_fn((height, width), |(row, column)| {
        ((row * 7919 + column * 104_729) % 1000) as f32 * 1e-3
    })
}

/// Return the packed bits of one frame.
fn bits(sensor: &Sensor<'_>, side: usize) -> Result<Array3<u8>> {
    let mut packed = Array3::zeros((1, HEIGHT * side, (WIDTH * side).div_ceil(8)));
    let all = Window {
        frames: 0..1,
        rows: 0..HEIGHT,
        columns: 0..WIDTH,
    };
    let image = image(HEIGHT, WIDTH);
    let image = Image::F32(image.view());
    expose(sensor, image, [7; 32], 0, &all, packed.view_mut())?;
    Ok(packed)
}

fn counting(c: &mut Criterion) -> Result<()> {
    let packed = bits(&sensor(SIDE)?, SIDE)?;
    let block = PackedBits::new(packed.view(), WIDTH * SIDE)?;
    let mut counts = Array2::zeros((HEIGHT, WIDTH));
    at_every_level(c, "counts of pixels", PIXELS, || {
        counts.fill(0);
        drop(add_block_counts(&block, SIDE, None, counts.view_mut()));
    });

    let frames = Array3::from_shape_fn((2000, 256, 64), |(t, row, byte)| {
        (t * 31 + row * 7 + byte * 13) as u8
    });
    let cube = PackedBits::new(frames.view(), 512)?;
    let mut sums = Array2::zeros((256, 512));
    at_every_level(c, "counts over frames", 2000 * 256 * 512, || {
        drop(add_block_counts(&cube, 1, None, sums.view_mut()));
    });
    Ok(())
}

fn exposure(c: &mut Criterion) -> Result<()> {
    let jots = PIXELS * SIDE * SIDE;
    let image = image(HEIGHT, WIDTH);
    let mut packed = Array3::zeros((1, HEIGHT * SIDE, (WIDTH * SIDE).div_ceil(8)));
    let all = Window {
        frames: 0..1,
        rows: 0..HEIGHT,
        columns: 0..WIDTH,
    };
    let mut cubic = sensor(SIDE)?;
    cubic.kernel = Kernel::new(3, SIDE)?;
    cubic.threshold = Threshold::new(2)?;
    for (name, sensor) in [
        ("drawing bits", sensor(SIDE)?),
        ("drawing bits, cubic, q = 2", cubic),
    ] {
        at_every_level(c, name, jots, || {
            let image = Image::F32(image.view());
            drop(expose(&sensor, image, [7; 32], 0, &all, packed.view_mut()));
        });
    }
    Ok(())
}

fn first_layers(c: &mut Criterion) -> Result<()> {
    let mut out = Array2::zeros((HEIGHT, WIDTH));
    for (name, side) in [("first layer", SIDE), ("first layer, K = 64", 8)] {
        let packed = bits(&sensor(side)?, side)?;
        let packed = PackedBits::new(packed.view(), WIDTH * side)?;
        let first = layer(Array4::ones((1, 1, side, side)), (side * side) as f32)?;
        at_every_level(c, name, PIXELS, || {
            drop(forward_bits(&[&first], &packed, out.view_mut()));
        });
    }
    Ok(())
}

fn two_layers(c: &mut Criterion) -> Result<()> {
    let tied = layer(Array4::ones((1, 1, 1, 1)), 16.0)?;
    let untied = layer(Array4::ones((1, 1, SIDE, SIDE)), 16.0)?;
    let second = layer(Array4::from_elem((1, 1, 15, 15), 1.0 / 225.0), 1.0)?;
    let mut plane: Vec<f32> = (0..PIXELS)
        .map(|k| (k * 7919 % 1600) as f32 * 0.01)
        .collect();
    at_every_level(c, "spline", PIXELS, || tied.splines()[0].apply(&mut plane));

    let mut out = Array2::zeros((HEIGHT, WIDTH));
    let sums = Array3::from_shape_fn((1, HEIGHT, WIDTH), |(_, row, column)| {
        ((row + column) % 16) as f32
    });
    at_every_level(c, "filter and two splines", PIXELS, || {
        drop(forward(&[&tied, &second], sums.view(), out.view_mut()));
    });

    let packed = bits(&sensor(SIDE)?, SIDE)?;
    let packed = PackedBits::new(packed.view(), WIDTH * SIDE)?;
    let mut counts = Array2::zeros((HEIGHT, WIDTH));
    add_block_counts(&packed, SIDE, None, counts.view_mut())?;
    let table = Array2::from_shape_fn((1, 17), |(_, count)| count as f32);
    at_every_level(c, "tied network from counts", PIXELS, || {
        drop(forward_counts(
            &[&tied, &second],
            counts.view(),
            table.view(),
            out.view_mut(),
        ));
    });
    at_every_level(c, "untied network from bits", PIXELS, || {
        drop(forward_bits(&[&untied, &second], &packed, out.view_mut()));
    });
    Ok(())
}

fn training(c: &mut Criterion) -> Result<()> {
    let layers = [
        layer(Array4::ones((1, 1, 1, 1)), 16.0)?,
        layer(Array4::from_elem((1, 1, 15, 15), 1.0 / 225.0), 1.0)?,
    ];
    let image = image(32, 32);
    let patch = Patch {
        image: 0,
        rows: 0..32,
        columns: 0..32,
    };
    let batch = Batch {
        sensor: sensor(SIDE)?,
        frames: 1,
        images: vec![image.view()],
        patches: vec![patch; 16],
        border: 0,
        seed: [3; 32],
    };
    at_every_level(c, "gradient of 16 patches", 16 * 32 * 32, || {
        drop(batch.gradient(&layers));
    });
    Ok(())
}

fn hot_paths(c: &mut Criterion) {
    for measure in [counting, exposure, first_layers, two_layers, training] {
        let result = measure(c);
        assert!(result.is_ok(), "{result:?}");
    }
}

criterion_group!(benches, hot_paths);
criterion_main!(benches);
