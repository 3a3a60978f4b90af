//! Several images in one call.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::interrupt;

/// Call `work` with each image in parallel, and collect what it returns. If it fails for several
/// images, the error is that of the first one, for any number of threads.
///
/// `work` may divide an image into parallel tasks.
pub(crate) fn for_each_image<Image, R, All>(
    images: impl IntoIterator<Item = Image>,
    work: impl Fn(Image) -> Result<R> + Send + Sync,
) -> Result<All>
where
    Image: Send,
    R: Send,
    All: FromIterator<R>,
{
    let images: Vec<_> = images.into_iter().enumerate().collect();
    let first_wrong = AtomicUsize::new(usize::MAX);
    let results: Vec<Result<R>> = images
        .into_par_iter()
        .map(|(index, image)| {
            let is_needless = index > first_wrong.load(Ordering::Relaxed);
            if is_needless || interrupt::is_requested() {
                return Err(Error::Interrupted);
            }
            work(image).inspect_err(|_| {
                first_wrong.fetch_min(index, Ordering::Relaxed);
            })
        })
        .collect();
    results.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use std::thread::sleep;
    use std::time::Duration;

    use super::*;

    #[test]
    fn the_error_of_the_first_wrong_image_is_returned() {
        let work = |image: usize| {
            if image.is_multiple_of(2) {
                return Ok(image);
            }
            if image == 1 {
                // The other threads find the errors of later images meanwhile.
                sleep(Duration::from_millis(5));
            }
            Err(Error::range("image", "an even number", image))
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(4).build();
        let run = || for_each_image::<_, _, Vec<_>>(0..64, work);
        let found = pool.map(|pool| pool.install(run));
        let expected = Error::range("image", "an even number", 1);
        assert!(matches!(found, Ok(Err(error)) if error == expected));
    }
}
