//! The images that networks write: their sizes, their memory layout, and their data.

use jotlight::bits::PackedBits;
use jotlight::error::{Error, Result};
use jotlight::mle::JotResponses;
use jotlight::network::{EquivalentCounts, LocalTrials, Network, Pixels, Served};
use jotlight::values::Values;
use ndarray::{ArcArray, Array2, Array3, ArrayViewMut2, Ix2, s};

use crate::model::{identity, sensor};

fn network() -> Result<Network> {
    let layers = vec![identity(1), identity(5)];
    Network::new(layers, Served::Trials { min: 1, max: 256 })
}

fn counts(rows: usize) -> Array2<f32> {
    Array2::from_shape_fn((rows, 12), |(row, column)| {
        ((row * 5 + column) % 9) as f32 / 2.0
    })
}

fn equivalent<'a>(counts: &'a Array2<f32>, trials: &ArcArray<f32, Ix2>) -> EquivalentCounts<'a> {
    EquivalentCounts {
        counts: counts.view(),
        of: 4,
        trials: LocalTrials::Map(trials.clone()),
    }
}

#[test]
fn images_of_different_sizes_may_share_a_map_of_trials() -> Result<()> {
    let network = network()?;
    let reconstruction = network.prepare(sensor(4, 1.0)?)?;
    let large = ArcArray::from_shape_fn((20, 12), |(row, column)| (1 + row * column) as f32);
    let small = large.clone().slice_move(s![..9, ..]);
    let data = [counts(9), counts(20)];
    let images = [equivalent(&data[0], &small), equivalent(&data[1], &large)];
    let (mut first, mut second) = (Array2::zeros((9, 12)), Array2::zeros((20, 12)));
    reconstruction.equivalent_counts(&images, vec![first.view_mut(), second.view_mut()])?;
    for (image, found) in images.iter().zip([first, second]) {
        let mut alone = Array2::zeros(found.dim());
        let one = std::slice::from_ref(image);
        reconstruction.equivalent_counts(one, vec![alone.view_mut()])?;
        assert_eq!(found, alone);
    }
    Ok(())
}

#[test]
fn equivalent_counts_that_are_negative_or_not_finite_are_refused() -> Result<()> {
    let network = network()?;
    let reconstruction = network.prepare(sensor(4, 1.0)?)?;
    let trials = ArcArray::from_shape_fn((9, 12), |(row, _)| (1 + 9 * row) as f32);
    for value in [-1e-3, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut data = counts(9);
        data[[3, 5]] = value;
        let different = equivalent(&data, &trials);
        let same = EquivalentCounts {
            trials: LocalTrials::Same(4),
            ..different.clone()
        };
        for image in [different, same] {
            let mut out = Array2::zeros((9, 12));
            let found = reconstruction.equivalent_counts(&[image], vec![out.view_mut()]);
            assert!(matches!(found, Err(Error::Range { what: "counts", .. })));
        }
    }
    Ok(())
}

#[test]
fn an_image_whose_squares_have_too_many_ones_has_none() -> Result<()> {
    let network = network()?;
    let reconstruction = network.prepare(sensor(4, 1e-12)?)?;
    let counts = Array2::from_elem((32, 40), i32::MAX / 2);
    let pixels = Pixels {
        counts: counts.view(),
        trials: Values::Same(1e11),
        jots: JotResponses {
            efficiency: Values::Same(0.8),
            dark_counts: Values::Same(0.01),
        },
    };
    let mut found = Array2::from_elem((32, 40), f32::NAN);
    reconstruction.pixels(&pixels, found.view_mut())?;
    // All bits of these pixels are explained by S, which is the largest intensity.
    assert_eq!(found, Array2::from_elem((32, 40), 1.0));
    Ok(())
}

/// Check that a function refuses an image with gaps, and states what it expects.
fn assert_gaps_are_refused(write: impl Fn(ArrayViewMut2<'_, f32>) -> Result<()>) {
    let mut wide = Array2::zeros((4, 12));
    let message = write(wide.slice_mut(s![.., ..;2]))
        .map_or_else(|error| error.to_string(), |()| String::new());
    let expected = "out: expected contiguous rows of the shape (4, 6), \
                    got the shape (4, 6) with strides [12, 2]";
    assert_eq!(message, expected);
    let mut whole = Array2::zeros((4, 6));
    assert_eq!(write(whole.view_mut()), Ok(()));
}

#[test]
fn outputs_with_gaps_are_refused() -> Result<()> {
    let network = network()?;
    let turned = network.clone().with_rotations(2)?;
    let (counts, bytes) = (Array2::from_elem((4, 6), 2), Array3::zeros((4, 4, 1)));
    let bits = PackedBits::new(bytes.view(), 6)?;
    let trials = Array2::from_shape_fn((4, 6), |(row, _)| (4 + 9 * row) as f64);
    // K within the range of the network, and beyond it.
    for k in [4, 1000] {
        for network in [&network, &turned] {
            let reconstruction = network.prepare(sensor(k, 1.0)?)?;
            assert_gaps_are_refused(|out| reconstruction.counts(counts.view(), out));
            assert_gaps_are_refused(|out| {
                reconstruction.counts_of_trials(counts.view(), trials.view(), out)
            });
            if k == 4 {
                assert_gaps_are_refused(|out| reconstruction.bits(&bits, 1, out));
            }
        }
    }
    Ok(())
}
