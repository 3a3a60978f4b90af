//! Affine fits to the displacement errors of several blocks of frames.

use ndarray::ArrayView2;
use rayon::prelude::*;

use super::affine::{AffineFit, fit_affine};
use super::count::Count;
use super::equations::{EquationsView, normal_equations};
use super::sums::Sums;
use super::template::Template;
use crate::bits::contiguous;
use crate::error::Result;

/// The blocks of a template.
#[derive(Clone, Copy, Debug)]
pub struct Share {
    /// The mean number of trials of a pixel of the template.
    pub mean_trials: f64,
    /// The smallest assumed share of all other blocks.
    pub min_others: f64,
}

/// Return the affine displacement errors of blocks that are part of a template, and the information
/// about them.
///
/// A block itself is a share of the template, which makes its apparent error smaller. So the right
/// sides of its [`normal_equations`] are divided by the share of the other blocks. `weights` and
/// `basis` are those of [`fit_affine`].
///
/// # Errors
/// Those of [`normal_equations`] and [`fit_affine`].
pub fn fit_blocks<C: Count>(
    template: &Template,
    share: Share,
    blocks: &[Sums<'_, C>],
    weights: ArrayView2<'_, f64>,
    basis: ArrayView2<'_, f64>,
) -> Result<Vec<AffineFit>> {
    let fit = |sums: &Sums<'_, C>| {
        let mut equations = normal_equations(template, *sums)?;
        let total: f64 = sums.trials.rows().into_iter().map(sum_row).sum();
        let mean = total / (sums.trials.len().max(1) as f64);
        let others = (1.0 - mean / share.mean_trials.max(1e-9)).max(share.min_others);
        equations.right.mapv_inplace(|value| value / others);
        let view = EquationsView {
            information: equations.information.view(),
            right: equations.right.view(),
        };
        fit_affine(view, weights, basis)
    };
    blocks.par_iter().map(fit).collect()
}

/// Return the sum of a row of counts.
fn sum_row<C: Count>(row: ndarray::ArrayView1<'_, C>) -> f64 {
    C::sum(&contiguous(row))
}
