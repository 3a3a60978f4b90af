//! The mean of a network's output over rotations of the data by 90 degrees.

use ndarray::{Array3, ArrayBase, ArrayView3, Axis, Ix3, RawData, s};

use crate::border::mirror_index;
use crate::error::Result;

/// Return planes `(C, H, W)`, rotated counterclockwise `turns` times by 90 degrees.
fn rotated<S: RawData>(mut planes: ArrayBase<S, Ix3>, turns: usize) -> ArrayBase<S, Ix3> {
    for _ in 0..turns % 4 {
        planes.swap_axes(1, 2);
        planes.invert_axis(Axis(1));
    }
    planes
}

/// Return the mean of the outputs of `evaluate` for several rotations of planes `(C, H, W)`.
///
/// The planes are padded to multiples of `divisor`. So strides meet the same pixels in the rotation
/// of a part as in that of the whole image.
pub(super) fn mean_of_rotations(
    planes: ArrayView3<'_, f32>,
    rotations: usize,
    divisor: usize,
    evaluate: impl Fn(ArrayView3<'_, f32>) -> Result<Array3<f32>>,
) -> Result<Array3<f32>> {
    if rotations == 1 {
        return evaluate(planes);
    }
    let (_, height, width) = planes.dim();
    let padded = padded_to_multiple(planes, divisor);
    let mut total: Option<Array3<f32>> = None;
    for turns in 0..rotations {
        let turned = rotated(padded.view(), turns);
        let output = evaluate(turned.as_standard_layout().view())?;
        let output = rotated(output.view(), 4 - turns % 4);
        match &mut total {
            Some(total) => *total += &output,
            None => total = Some(output.to_owned()),
        }
    }
    let mean = total.unwrap_or_default() / rotations as f32;
    Ok(mean.slice_move(s![.., ..height, ..width]))
}

/// Return planes with mirrored rows and columns appended, up to multiples of a number.
fn padded_to_multiple(planes: ArrayView3<'_, f32>, divisor: usize) -> Array3<f32> {
    let (channels, height, width) = planes.dim();
    let shape = (
        channels,
        height.next_multiple_of(divisor),
        width.next_multiple_of(divisor),
    );
    Array3::from_shape_fn(shape, |(channel, row, column)| {
        let mirror = |index, size| mirror_index(index as isize, size);
        planes[[channel, mirror(row, height), mirror(column, width)]]
    })
}

#[cfg(test)]
mod tests {
    use ndarray::array;

    use super::*;

    #[test]
    fn a_rotation_is_counterclockwise() {
        let planes = array![[[1, 2, 3], [4, 5, 6]]];
        assert_eq!(rotated(planes.clone(), 1), array![[[3, 6], [2, 5], [1, 4]]]);
        assert_eq!(rotated(planes.clone(), 2), array![[[6, 5, 4], [3, 2, 1]]]);
        assert_eq!(rotated(rotated(planes.clone(), 3), 1), planes);
    }

    #[test]
    fn every_rotation_sees_whole_steps_and_is_turned_back() -> Result<()> {
        let planes = Array3::from_shape_fn((2, 3, 5), |(c, y, x)| (c * 100 + y * 10 + x) as f32);
        let mean = mean_of_rotations(planes.view(), 4, 4, |planes| {
            assert!(planes.dim() == (2, 4, 8) || planes.dim() == (2, 8, 4));
            Ok(planes.to_owned())
        })?;
        assert_eq!(mean, planes);
        // Each rotation adds the sum over all pixels, whatever its direction.
        let first = |planes: ArrayView3<'_, f32>| {
            let corner = planes[[0, 0, 0]];
            Ok(planes.mapv(|_| corner))
        };
        let mean = mean_of_rotations(planes.view(), 4, 1, first)?;
        assert_eq!(
            mean,
            Array3::from_elem((2, 3, 5), (0.0 + 4.0 + 24.0 + 20.0) / 4.0)
        );
        Ok(())
    }

    #[test]
    fn the_padding_mirrors_the_border() {
        let planes = array![[[1.0, 2.0]]];
        let expected = [1.0, 2.0, 2.0, 1.0, 1.0];
        let padded = padded_to_multiple(planes.view(), 5);
        assert_eq!(padded.dim(), (1, 5, 5));
        for row in padded.index_axis(Axis(0), 0).rows() {
            assert_eq!(row.to_vec(), expected);
        }
    }
}
