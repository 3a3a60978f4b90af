//! The hot paths one by one, on one thread, at every instruction set that this processor has: `cargo bench`.

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
const SIDE: usize = 4;

/// Runs `work` for every instruction set, and says how many items a call is for.
fn at_every_level(c: &mut Criterion, name: &str, items: usize, mut work: impl FnMut() + Send) {
    let mut group = c.benchmark_group(name);
    group.throughput(Throughput::Elements(items as u64));
    for level in Level::supported() {
        let chosen = Level::choose(Some(level.name()));
        assert!(chosen.is_ok(), "{chosen:?}");
        group.bench_function(level.name(), |b| {
            let done = install(Some(1), || b.iter(&mut work));
            assert!(done.is_ok(), "{done:?}");
        });
    }
    group.finish();
}

/// A layer whose φ is a smooth curve with as many knots as the pretrained ones have.
fn layer(filters: Array4<f32>, range: f32) -> Result<Layer<f32>> {
    let bend = Array2::from_shape_fn((filters.dim().0, 150), |(_, k)| (k as f32 / 150.0).sqrt());
    Layer::new(
        filters,
        Some(bend.view()),
        0.0,
        range / 147.0,
        Wiring::default(),
    )
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

fn scene(height: usize, width: usize) -> Array2<f32> {
    Array2::from_shape_fn((height, width), |(row, column)| {
        ((row * 7919 + column * 104_729) % 1000) as f32 * 1e-3
    })
}

fn bits(sensor: &Sensor<'_>, side: usize, frames: usize) -> Result<Array3<u8>> {
    let mut packed = Array3::zeros((frames, HEIGHT * side, (WIDTH * side).div_ceil(8)));
    let all = Window {
        frames: 0..frames,
        rows: 0..HEIGHT,
        columns: 0..WIDTH,
    };
    let scene = scene(HEIGHT, WIDTH);
    let image = Image::F32(scene.view());
    expose(sensor, image, [7; 32], 0, &all, packed.view_mut())?;
    Ok(packed)
}

fn hot_paths(c: &mut Criterion) -> Result<()> {
    let pixels = HEIGHT * WIDTH;
    let sensor = sensor(SIDE)?;
    let packed = bits(&sensor, SIDE, 1)?;
    let block = PackedBits::new(packed.view(), WIDTH * SIDE)?;
    let mut counts = Array2::zeros((HEIGHT, WIDTH));
    at_every_level(c, "counts of pixels", pixels, || {
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

    let mut drawn = Array3::zeros(packed.dim());
    let all = Window {
        frames: 0..1,
        rows: 0..HEIGHT,
        columns: 0..WIDTH,
    };
    let scene = scene(HEIGHT, WIDTH);
    at_every_level(c, "drawing bits", pixels * SIDE * SIDE, || {
        let image = Image::F32(scene.view());
        drop(expose(&sensor, image, [7; 32], 0, &all, drawn.view_mut()));
    });

    let mut cubic = self::sensor(SIDE)?;
    cubic.kernel = Kernel::new(3, SIDE)?;
    cubic.threshold = Threshold::new(2)?;
    at_every_level(
        c,
        "drawing bits, cubic, q = 2",
        pixels * SIDE * SIDE,
        || {
            let image = Image::F32(scene.view());
            drop(expose(&cubic, image, [7; 32], 0, &all, drawn.view_mut()));
        },
    );

    let tied = layer(Array4::ones((1, 1, 1, 1)), 16.0)?;
    let untied = layer(Array4::ones((1, 1, SIDE, SIDE)), 16.0)?;
    let second = layer(Array4::from_elem((1, 1, 15, 15), 1.0 / 225.0), 1.0)?;
    let mut plane: Vec<f32> = (0..pixels)
        .map(|k| (k * 7919 % 1600) as f32 * 0.01)
        .collect();
    at_every_level(c, "spline", pixels, || tied.splines()[0].apply(&mut plane));
    let one = [&untied];
    at_every_level(c, "first layer", pixels, || {
        drop(forward_bits(&one, &block));
    });
    let of_eight = self::bits(&self::sensor(8)?, 8, 1)?;
    let large = PackedBits::new(of_eight.view(), WIDTH * 8)?;
    let eight = layer(Array4::ones((1, 1, 8, 8)), 64.0)?;
    let one = [&eight];
    at_every_level(c, "first layer, K = 64", pixels, || {
        drop(forward_bits(&one, &large));
    });
    let given = layer(Array4::ones((1, 1, 1, 1)), 16.0)?;
    let filter = [&given, &second];
    let planes = Array3::from_shape_fn((1, HEIGHT, WIDTH), |(_, row, column)| {
        ((row + column) % 16) as f32
    });
    at_every_level(c, "filter and two splines", pixels, || {
        drop(forward(&filter, planes.view()));
    });
    let table = Array2::from_shape_fn((1, 17), |(_, count)| count as f32);
    let network = [&tied, &second];
    at_every_level(c, "tied network from counts", pixels, || {
        drop(forward_counts(&network, counts.view(), table.view()));
    });
    let weighing = [&untied, &second];
    at_every_level(c, "untied network from bits", pixels, || {
        drop(forward_bits(&weighing, &block));
    });

    let scenes = self::scene(32, 32);
    let patch = Patch {
        image: 0,
        rows: 0..32,
        columns: 0..32,
    };
    let batch = Batch {
        sensor: self::sensor(SIDE)?,
        frames: 1,
        images: vec![scenes.view()],
        patches: vec![patch; 16],
        border: 0,
        seed: [3; 32],
    };
    at_every_level(c, "gradient of 16 patches", 16 * 32 * 32, || {
        drop(batch.gradient(&network.map(Layer::clone)));
    });
    Ok(())
}

fn all(c: &mut Criterion) {
    let done = hot_paths(c);
    assert!(done.is_ok(), "{done:?}");
}

criterion_group!(benches, all);
criterion_main!(benches);
