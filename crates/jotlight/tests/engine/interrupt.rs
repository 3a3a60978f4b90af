//! Calls that would take minutes or centuries end soon after an interruption.

use std::sync::atomic::{AtomicUsize, Ordering};

use jotlight::bits::{PackedBits, add_block_counts};
use jotlight::error::{Error, Result};
use jotlight::likelihood::{Readings, Threshold};
use jotlight::mle::{JotResponse, PixelResponse, from_probability};
use jotlight::motion::{Sums, Template, normal_equations};
use jotlight::network::{Batch, Layer, Patch, Wiring, forward};
use jotlight::roofline::multiply_adds;
use jotlight::sensing::{Image, Kernel, PerJot, Sensor, Window, expose, probability};
use jotlight::threads::{install, install_interruptible};
use jotlight::values::Values;
use jotlight::vst::ExactInverse;
use ndarray::{Array2, Array3, Array4, ArrayView3, ShapeBuilder};

/// Check that a call ends when it is interrupted, and that the next call does not.
fn assert_ends<R: Send>(work: impl Fn() -> Result<R> + Sync) {
    // A single thread is the calling thread.
    for threads in [1, 2] {
        let result = install_interruptible(Some(threads), || true, || work().map(|_| ()));
        assert_eq!(result, Err(Error::Interrupted));
        assert_eq!(
            install(Some(threads), || multiply_adds(3)),
            install(Some(threads), || multiply_adds(3))
        );
    }
}

fn slow_threshold() -> Result<Threshold> {
    Threshold::new(Threshold::MAX_PHOTONS)
}

fn layer(outputs: usize, inputs: usize, size: usize) -> Result<Layer<f32>> {
    let filters = Array4::from_elem((outputs, inputs, size, size), 0.01);
    let coefficients = Array2::from_elem((outputs, 8), 0.5);
    Layer::new(
        filters,
        Some(coefficients.view()),
        0.0,
        1.0,
        Wiring::default(),
    )
}

fn sensor<'a>(threshold: Threshold) -> Result<Sensor<'a>> {
    Ok(Sensor {
        kernel: Kernel::new(0, 1)?,
        gain_per_frame: 1.0,
        efficiency: PerJot::Same(1.0),
        dark_counts: PerJot::Same(0.0),
        dead: None,
        threshold,
    })
}

#[test]
fn a_call_without_an_interruption_has_a_result() {
    static QUESTIONS: AtomicUsize = AtomicUsize::new(0);
    for threads in [1, 2] {
        let before = QUESTIONS.load(Ordering::Relaxed);
        let result = install_interruptible(
            Some(threads),
            || {
                QUESTIONS.fetch_add(1, Ordering::Relaxed);
                false
            },
            || {
                std::thread::sleep(std::time::Duration::from_millis(200));
                let _ = multiply_adds(1);
                Ok(7)
            },
        );
        assert_eq!(result, Ok(7));
        assert!(QUESTIONS.load(Ordering::Relaxed) > before);
    }
}

#[test]
fn an_interruption_does_not_end_other_calls() {
    std::thread::scope(|scope| {
        let other = scope.spawn(|| install(Some(2), || multiply_adds(1 << 24)));
        assert_ends(|| Ok(multiply_adds(usize::MAX)));
        assert!(matches!(other.join(), Ok(Ok(operations)) if operations > 0));
    });
}

#[test]
fn a_panic_reaches_the_caller_and_later_calls_work() {
    let panicked =
        std::panic::catch_unwind(|| install(Some(2), || std::panic::resume_unwind(Box::new(1))));
    assert!(panicked.is_err());
    assert_eq!(install(Some(2), || 5), Ok(5));
}

#[test]
fn counting_ends() -> Result<()> {
    let frames =
        |number: usize| ArrayView3::from_shape((number, 64, 1).strides((0, 1, 1)), &[255; 64]);
    let packed = frames((1 << 31) - 1).map_err(|_| Error::Interrupted)?;
    let bits = PackedBits::new(packed, 8)?;
    assert_ends(|| add_block_counts(&bits, 1, None, Array2::zeros((64, 8)).view_mut()));
    let few = frames((1 << 25) - 1).map_err(|_| Error::Interrupted)?;
    let bits = PackedBits::new(few, 8)?;
    assert_ends(|| add_block_counts(&bits, 8, None, Array2::zeros((8, 1)).view_mut()));
    Ok(())
}

#[test]
fn simulations_end() -> Result<()> {
    let image = Array2::from_elem((1 << 11, 1 << 11), 65_000.0f32);
    let (sensor, light) = (sensor(slow_threshold()?)?, Image::F32(image.view()));
    assert_ends(|| probability(&sensor, light, 0, Array2::zeros(image.dim()).view_mut()));
    let window = Window {
        frames: 0..1 << 12,
        rows: 0..1 << 11,
        columns: 0..1 << 11,
    };
    assert_ends(|| {
        let mut out = Array3::zeros((1 << 12, 1 << 11, 1 << 8));
        expose(&sensor, light, [0; 32], 0, &window, out.view_mut())
    });
    Ok(())
}

#[test]
fn likelihoods_end() -> Result<()> {
    const ELEMENTS: usize = 1 << 22;
    let (ones, light) = (vec![1; ELEMENTS], vec![65_000.0; ELEMENTS]);
    let (trials, efficiency) = (Values::Same(2.0), Values::Same(1.0));
    let readings = Readings::new(
        slow_threshold()?,
        &ones,
        trials,
        efficiency,
        Values::Same(0.0),
    )?;
    let out = || vec![0.0; ELEMENTS];
    assert_ends(|| readings.value(&light));
    assert_ends(|| readings.gradient_and_curvature(&light, &mut out(), &mut out()));
    assert_ends(|| readings.information(&light, &mut out()));
    assert_ends(|| readings.proximal(1.0, 1e6, &light, &mut light.clone()));
    Ok(())
}

#[test]
fn inverses_end() -> Result<()> {
    let response = PixelResponse {
        threshold: slow_threshold()?,
        light_per_intensity: 1.0,
        max_intensity: 1e6,
    };
    let jot = JotResponse {
        efficiency: 1.0,
        dark_counts: 0.0,
    };
    let p = vec![0.3f32; 1 << 20];
    let write = |mut out: Vec<f32>| from_probability(&response, &p, jot, &mut out);
    // One call may end before the question whether it is interrupted.
    assert_ends(|| (0..99).try_for_each(|_| write(vec![0.0; p.len()])));
    assert_ends(|| (0..99).try_for_each(|_| ExactInverse::new(u32::MAX).map(|_| ())));
    Ok(())
}

#[test]
fn normal_equations_end() -> Result<()> {
    const SIZE: usize = 4000;
    let probability = Array2::from_elem((SIZE, SIZE), 0.5f32);
    let counts = Array2::ones((SIZE, SIZE));
    assert_ends(|| Template::new(probability.view(), counts.view(), 30.0));
    let template = Template::new(probability.view(), counts.view(), 10.0)?;
    let remainders = Array3::zeros((SIZE, 2, SIZE.div_ceil(16)));
    let sums = Sums {
        ones: counts.view(),
        trials: counts.view(),
        remainders: remainders.view(),
        frames: 1,
    };
    // One call may end before the question whether it is interrupted.
    assert_ends(|| (0..50).try_for_each(|_| normal_equations(&template, sums).map(drop)));
    Ok(())
}

#[test]
fn networks_end() -> Result<()> {
    let winograd = [
        layer(1, 1, 1)?,
        layer(64, 1, 3)?,
        layer(64, 64, 3)?,
        layer(1, 64, 3)?,
    ];
    let large_filters = [layer(2, 1, 1)?, layer(2, 2, 201)?, layer(1, 2, 201)?];
    for layers in [&winograd[..], &large_filters[..]] {
        let layers: Vec<_> = layers.iter().collect();
        let sums = Array3::from_elem((layers[0].channels(), 3000, 3000), 0.5);
        assert_ends(|| {
            let mut out = Array2::zeros((3000, 3000));
            forward(&layers, sums.view(), out.view_mut())
        });
    }
    Ok(())
}

#[test]
fn training_ends() -> Result<()> {
    let layers = [layer(8, 1, 1)?, layer(1, 8, 11)?];
    let image = Array2::from_elem((1000, 1000), 0.5f32);
    let batch = Batch {
        sensor: sensor(Threshold::new(1)?)?,
        frames: 1,
        images: vec![image.view()],
        patches: vec![
            Patch {
                image: 0,
                rows: 0..1000,
                columns: 0..1000,
            };
            200
        ],
        border: 0,
        seed: [0; 32],
    };
    assert_ends(|| batch.squared_errors(&layers));
    assert_ends(|| batch.gradient(&layers));
    assert_ends(|| batch.normal_equations(&layers));
    Ok(())
}
