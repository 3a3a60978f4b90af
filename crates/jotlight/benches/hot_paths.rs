//! Benchmarks of the hot paths on one thread, at every supported instruction set: `cargo bench`.

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
const OVERSAMPLING: usize = 4;
const SEED: [u8; 32] = [7; 32];

/// Run `work`, which processes `items` items, at every supported instruction set.
fn at_every_level(c: &mut Criterion, name: &str, items: usize, mut work: impl FnMut() + Send) {
    let mut group = c.benchmark_group(name);
    group.throughput(Throughput::Elements(items as u64));
    for level in Level::supported() {
        let result = Level::choose(Some(level.name()));
        assert!(result.is_ok(), "{result:?}");
        group.bench_function(level.name(), |b| {
            let result = install(Some(1), || b.iter(&mut work));
            assert!(result.is_ok(), "{result:?}");
        });
    }
    group.finish();
}

/// Return a layer with a smooth spline that has as many knots as those of the pretrained networks.
fn layer(filters: Array4<f32>, range: f32) -> Result<Layer<f32>> {
    let coefficients =
        Array2::from_shape_fn((filters.dim().0, 150), |(_, k)| (k as f32 / 150.0).sqrt());
    Layer::new(
        filters,
        Some(coefficients.view()),
        0.0,
        range / 147.0,
        Wiring::default(),
    )
}

fn sensor<'a>(oversampling: usize) -> Result<Sensor<'a>> {
    Ok(Sensor {
        kernel: Kernel::new(0, oversampling)?,
        gain_per_frame: (oversampling * oversampling) as f64,
        efficiency: PerJot::Same(1.0),
        dark_counts: PerJot::Same(0.0),
        dead: None,
        threshold: Threshold::new(1)?,
    })
}

fn test_image(height: usize, width: usize) -> Array2<f32> {
    Array2::from_shape_fn((height, width), |(row, column)| {
        ((row * 7919 + column * 104_729) % 1000) as f32 * 1e-3
    })
}

/// Return the window of all pixels in one frame.
fn whole() -> Window {
    Window {
        frames: 0..1,
        rows: 0..HEIGHT,
        columns: 0..WIDTH,
    }
}

/// Return the packed bits of one frame of the test image.
fn bits(oversampling: usize) -> Result<Array3<u8>> {
    let sensor = sensor(oversampling)?;
    let row_bytes = (WIDTH * oversampling).div_ceil(8);
    let mut packed = Array3::zeros((1, HEIGHT * oversampling, row_bytes));
    let test_image = test_image(HEIGHT, WIDTH);
    let image = Image::F32(test_image.view());
    expose(&sensor, image, SEED, 0, &whole(), packed.view_mut())?;
    Ok(packed)
}

fn counting(c: &mut Criterion) -> Result<()> {
    let packed = bits(OVERSAMPLING)?;
    let frame = PackedBits::new(packed.view(), WIDTH * OVERSAMPLING)?;
    let mut counts = Array2::zeros((HEIGHT, WIDTH));
    at_every_level(c, "counts of pixels", PIXELS, || {
        counts.fill(0);
        drop(add_block_counts(
            &frame,
            OVERSAMPLING,
            None,
            counts.view_mut(),
        ));
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

fn exposing(c: &mut Criterion) -> Result<()> {
    let sensor = sensor(OVERSAMPLING)?;
    let cubic = Sensor {
        kernel: Kernel::new(3, OVERSAMPLING)?,
        threshold: Threshold::new(2)?,
        ..sensor.clone()
    };
    let test_image = test_image(HEIGHT, WIDTH);
    let image = Image::F32(test_image.view());
    let row_bytes = (WIDTH * OVERSAMPLING).div_ceil(8);
    let mut packed = Array3::zeros((1, HEIGHT * OVERSAMPLING, row_bytes));
    let jots = PIXELS * OVERSAMPLING * OVERSAMPLING;
    for (name, sensor) in [
        ("drawing bits", sensor),
        ("drawing bits, cubic, q = 2", cubic),
    ] {
        at_every_level(c, name, jots, || {
            let window = whole();
            drop(expose(&sensor, image, SEED, 0, &window, packed.view_mut()));
        });
    }
    Ok(())
}

fn first_layers(c: &mut Criterion) -> Result<()> {
    let tied = layer(Array4::ones((1, 1, 1, 1)), 16.0)?;
    let mut plane: Vec<f32> = (0..PIXELS)
        .map(|k| (k * 7919 % 1600) as f32 * 0.01)
        .collect();
    at_every_level(c, "spline", PIXELS, || tied.splines()[0].apply(&mut plane));
    for (name, oversampling) in [("first layer", 4), ("first layer, K = 64", 8)] {
        let packed = bits(oversampling)?;
        let frame = PackedBits::new(packed.view(), WIDTH * oversampling)?;
        let filters = Array4::ones((1, 1, oversampling, oversampling));
        let untied = [&layer(filters, (oversampling * oversampling) as f32)?];
        at_every_level(c, name, PIXELS, || drop(forward_bits(&untied, &frame)));
    }
    Ok(())
}

fn networks(c: &mut Criterion) -> Result<()> {
    let tied = layer(Array4::ones((1, 1, 1, 1)), 16.0)?;
    let untied = layer(Array4::ones((1, 1, OVERSAMPLING, OVERSAMPLING)), 16.0)?;
    let second = layer(Array4::from_elem((1, 1, 15, 15), 1.0 / 225.0), 1.0)?;
    let sums = Array3::from_shape_fn((1, HEIGHT, WIDTH), |(_, row, column)| {
        ((row + column) % 16) as f32
    });
    let tied_network = [&tied, &second];
    at_every_level(c, "filter and two splines", PIXELS, || {
        drop(forward(&tied_network, sums.view()));
    });
    let packed = bits(OVERSAMPLING)?;
    let frame = PackedBits::new(packed.view(), WIDTH * OVERSAMPLING)?;
    let mut counts = Array2::zeros((HEIGHT, WIDTH));
    add_block_counts(&frame, OVERSAMPLING, None, counts.view_mut())?;
    let table = Array2::from_shape_fn((1, 17), |(_, count)| count as f32);
    at_every_level(c, "tied network from counts", PIXELS, || {
        drop(forward_counts(&tied_network, counts.view(), table.view()));
    });
    let untied_network = [&untied, &second];
    at_every_level(c, "untied network from bits", PIXELS, || {
        drop(forward_bits(&untied_network, &frame));
    });

    let patch_image = test_image(32, 32);
    let patch = Patch {
        image: 0,
        rows: 0..32,
        columns: 0..32,
    };
    let batch = Batch {
        sensor: sensor(OVERSAMPLING)?,
        frames: 1,
        images: vec![patch_image.view()],
        patches: vec![patch; 16],
        border: 0,
        seed: [3; 32],
    };
    at_every_level(c, "gradient of 16 patches", 16 * 32 * 32, || {
        drop(batch.gradient(&tied_network.map(Layer::clone)));
    });
    Ok(())
}

fn hot_paths(c: &mut Criterion) {
    for benchmark in [counting, exposing, first_layers, networks] {
        let result = benchmark(c);
        assert!(result.is_ok(), "{result:?}");
    }
}

criterion_group!(benches, hot_paths);
criterion_main!(benches);
