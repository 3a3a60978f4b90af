//! Arrays whose sizes follow from arguments. A size that exceeds the memory is an error. It does not
//! end the process.

use ndarray::{Array, Dimension, IntoDimension};

use crate::error::{Error, Result};

/// Check that memory for an array of values of the type `T` is available.
pub(crate) fn check<T>(what: &'static str, shape: &[usize]) -> Result<()> {
    // An array without values still has strides, so the product of its other sizes must fit too.
    let mut sizes = shape.iter().filter(|&&size| size > 0);
    let product = sizes.try_fold(1usize, |product, &size| product.checked_mul(size));
    let is_available = product.is_some_and(|product| {
        let length = if shape.contains(&0) { 0 } else { product };
        isize::try_from(product).is_ok() && Vec::<T>::new().try_reserve_exact(length).is_ok()
    });
    if is_available {
        Ok(())
    } else {
        Err(Error::Memory {
            what,
            shape: format!("{shape:?}"),
        })
    }
}

/// Return an array of zeros.
///
/// # Errors
/// [`Error::Memory`] if the memory for the array is not available.
pub(crate) fn zeros<T: Clone + Default, D: Dimension>(
    what: &'static str,
    shape: impl IntoDimension<Dim = D>,
) -> Result<Array<T, D>> {
    let shape = shape.into_dimension();
    check::<T>(what, shape.slice())?;
    Ok(Array::from_elem(shape, T::default()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lack_of_memory_states_the_shape_and_what_to_do() {
        let message = check::<f64>("weights", &[usize::MAX])
            .map_or_else(|error| error.to_string(), |()| String::new());
        let expected = format!(
            "weights: not enough memory for an array of the shape [{}]; request less at once, \
             such as a part of the image",
            usize::MAX
        );
        assert_eq!(message, expected);
    }
}
