//! Several images in one call.

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::interrupt;

/// Call `work` with each image in parallel, and collect what it returns.
///
/// `work` may divide an image into parallel tasks.
pub(crate) fn for_each_image<Image, R, All>(
    images: impl IntoIterator<Item = Image>,
    work: impl Fn(Image) -> Result<R> + Send + Sync,
) -> Result<All>
where
    Image: Send,
    R: Send,
    All: FromParallelIterator<R>,
{
    let images: Vec<_> = images.into_iter().collect();
    let results = images.into_par_iter().map(|image| {
        if interrupt::is_requested() {
            return Err(Error::Interrupted);
        }
        work(image)
    });
    results.collect()
}
