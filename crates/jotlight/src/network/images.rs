//! The evaluation of networks for several images in one call.

use ndarray::{ArrayViewMut, Dimension};

use crate::error::{Error, Result};
use crate::images::for_each_image;

/// The maximum number of pixels of images that are evaluated at the same time. Larger images have
/// several tiles, which run in parallel, and more images at once would not fit into the caches.
const MAX_PIXELS_IN_PARALLEL: usize = 1 << 12;

/// Run `evaluate` for each input, which writes an image. Small images are evaluated in parallel, the
/// others one after another, because each of them runs on all threads.
///
/// # Errors
/// [`Error::Shape`] if the numbers of inputs and images differ, and those of `evaluate`.
pub fn write_images<Input: Send, D: Dimension>(
    inputs: Vec<Input>,
    out: Vec<ArrayViewMut<'_, f32, D>>,
    evaluate: impl Fn(Input, ArrayViewMut<'_, f32, D>) -> Result<()> + Send + Sync,
) -> Result<()> {
    if inputs.len() != out.len() {
        return Err(Error::shape("out", inputs.len(), out.len()));
    }
    let places = inputs.into_iter().zip(out);
    let (small, large): (Vec<_>, Vec<_>) =
        places.partition(|(_, image)| image.len() <= MAX_PIXELS_IN_PARALLEL);
    large
        .into_iter()
        .try_for_each(|(input, out)| evaluate(input, out))?;
    for_each_image(small, |(input, out)| evaluate(input, out))
}
