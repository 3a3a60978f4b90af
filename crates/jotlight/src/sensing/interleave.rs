//! Values of pixels, in the order of jots.

use crate::cpu::levels;

levels! {
    /// Write planes, one for each position in a pixel, into `out`, pixel by pixel.
    ///
    /// A single plane serves all positions. `out` holds `period` values of each pixel.
    pub(super) fn interleave[T: Copy](
        plane_length: usize, planes: &[T], period: usize, out: &mut [T],
    ) = interleave_inlined;
}

#[inline(always)]
fn interleave_inlined<T: Copy>(plane_length: usize, planes: &[T], period: usize, out: &mut [T]) {
    if planes.len() == plane_length {
        match period {
            1 => out.copy_from_slice(planes),
            2 => repeat::<2, T>(planes, out),
            4 => repeat::<4, T>(planes, out),
            8 => repeat::<8, T>(planes, out),
            _ => {
                for (pixel, &value) in out.chunks_exact_mut(period).zip(planes) {
                    pixel.fill(value);
                }
            }
        }
        return;
    }
    match period {
        2 => transpose::<2, T>(planes, out),
        4 => transpose::<4, T>(planes, out),
        8 => transpose::<8, T>(planes, out),
        _ => {
            for (position, plane) in planes.chunks_exact(plane_length).enumerate() {
                for (pixel, &value) in out.chunks_exact_mut(period).zip(plane) {
                    pixel[position] = value;
                }
            }
        }
    }
}

#[inline(always)]
fn repeat<const PERIOD: usize, T: Copy>(plane: &[T], out: &mut [T]) {
    for (pixel, &value) in out.as_chunks_mut::<PERIOD>().0.iter_mut().zip(plane) {
        *pixel = [value; PERIOD];
    }
}

#[inline(always)]
fn transpose<const PERIOD: usize, T: Copy>(planes: &[T], out: &mut [T]) {
    let length = planes.len() / PERIOD;
    let planes: [&[T]; PERIOD] =
        std::array::from_fn(|plane| &planes[plane * length..(plane + 1) * length]);
    let out = &mut out.as_chunks_mut::<PERIOD>().0[..length];
    for pixel in 0..length {
        for position in 0..PERIOD {
            out[pixel][position] = planes[position][pixel];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_period_has_the_same_order() {
        for period in 1..12 {
            for pixels in [1, 2, 15, 64, 131] {
                let planes: Vec<u16> = (0..(period * pixels) as u16).collect();
                let mut out = vec![0; period * pixels];
                interleave(pixels, &planes, period, &mut out);
                for (jot, &value) in out.iter().enumerate() {
                    assert_eq!(usize::from(value), jot % period * pixels + jot / period);
                }
                interleave(pixels, &planes[..pixels], period, &mut out);
                for (jot, &value) in out.iter().enumerate() {
                    assert_eq!(usize::from(value), jot / period);
                }
            }
        }
    }
}
