//! Sums of counts of several blocks: their values, and those that no `i32` can hold.

use jotlight::error::{Error, Result};
use jotlight::motion::{
    Accepted, Counts, Limits, Tested, Totals, accept_agreeing, add_accepted, add_counts,
};
use ndarray::{Array2, ArrayViewMut2, ShapeBuilder};

const SIZE: (usize, usize) = (3, 21);

fn image<T: Clone>(value: T) -> Array2<T> {
    Array2::from_elem(SIZE, value)
}

fn is_too_large<T>(result: Result<T>) -> bool {
    matches!(result, Err(Error::Range { what: "counts", .. }))
}

/// Check that a function that adds `increase` to all sums refuses those that it makes too large.
fn check_limit(increase: i32, add: impl Fn(ArrayViewMut2<'_, i32>) -> Result<()>) -> Result<()> {
    for is_fortran in [false, true] {
        let sums = || Array2::from_elem(SIZE.set_f(is_fortran), i32::MAX - increase);
        let mut below = sums();
        add(below.view_mut())?;
        assert!(below.iter().all(|&sum| sum == i32::MAX));
        for place in [(0, 0), (1, 8), (2, 20)] {
            let mut one_more = sums();
            one_more[place] += 1;
            assert!(is_too_large(add(one_more.view_mut())));
        }
    }
    Ok(())
}

#[test]
fn sums_beyond_their_type_are_errors() -> Result<()> {
    let (two, six, test) = (image(2), image(6), image(0.5));
    check_limit(6, |sums| add_counts(&[two.view(); 3], sums))?;
    let accept = |ones: ArrayViewMut2<'_, i32>, trials: ArrayViewMut2<'_, i32>| {
        let mut mask = Array2::zeros((SIZE.0, SIZE.1.div_ceil(8)));
        let block = Accepted {
            counts: [six.view(), six.view()],
            sums: [ones, trials],
            mask: mask.view_mut(),
        };
        add_accepted(test.view(), 1.0, block)
    };
    check_limit(6, |sums| accept(sums, image(0).view_mut()))?;
    check_limit(6, |sums| accept(image(0).view_mut(), sums))?;
    let mut negative = image(i32::MIN);
    assert!(is_too_large(add_counts(
        &[image(-1).view()],
        negative.view_mut()
    )));
    Ok(())
}

#[test]
fn totals_beyond_their_type_are_errors() -> Result<()> {
    let (ones, trials, probability) = (image(3), image(6), image(0.5));
    let block = Tested {
        near: vec![Counts {
            ones: ones.view(),
            trials: trials.view(),
        }],
        own: 0,
    };
    let limits = Limits {
        chi_squared: f32::INFINITY,
        change: 0.1,
    };
    for (index, increase) in [(0, 3), (1, 6), (2, 6)] {
        check_limit(increase, |total| {
            let (mut one, mut other) = (image(0), image(0));
            let mut mask = Array2::zeros((SIZE.0, SIZE.1.div_ceil(8)));
            let (one, other) = (one.view_mut(), other.view_mut());
            let [accepted, of, available] = match index {
                0 => [total, one, other],
                1 => [one, total, other],
                _ => [one, other, total],
            };
            let totals = Totals {
                accepted: [accepted, of],
                available,
                masks: vec![mask.view_mut()],
            };
            let template = (probability.view(), trials.view());
            let is_same = accept_agreeing(template, limits, std::slice::from_ref(&block), totals)?;
            assert_eq!(is_same, [true]);
            Ok(())
        })?;
    }
    Ok(())
}
