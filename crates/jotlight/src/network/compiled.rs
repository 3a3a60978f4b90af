//! Functions of networks that are compiled in this crate.
//!
//! A generic function is compiled again in each crate that calls it. Those below contain nearly all
//! loops of a network, whose compilation takes minutes.

use ndarray::{Array2, Array3, ArrayView3, ArrayViewMut3};

use super::forward;
use super::layer::Layer;
use super::spline::channels::Splines;
use super::training::batch::{Batch, Gradient, NormalEquations};
use crate::error::Result;
use crate::numbers::Real;

/// A type of numbers for which the functions of networks are compiled: `f32` or `f64`. Other types
/// cannot implement this trait.
pub trait Compiled: Real {
    /// Call [`super::forward_planes`].
    ///
    /// # Errors
    /// Those of that function.
    fn forward_planes(
        layers: &[&Layer<Self>],
        sums: ArrayView3<'_, Self>,
        out: ArrayViewMut3<'_, Self>,
    ) -> Result<()>;
    /// Call [`Splines::activate`].
    ///
    /// # Errors
    /// Those of that function.
    fn activate(splines: &Splines<Self>, planes: ArrayView3<'_, Self>) -> Result<Array3<Self>>;
    /// Call [`Splines::pull_back`].
    ///
    /// # Errors
    /// Those of that function.
    fn pull_back(
        splines: &Splines<Self>,
        planes: ArrayView3<'_, Self>,
        gradient: ArrayView3<'_, Self>,
    ) -> Result<(Array3<Self>, Array2<f64>)>;
    /// Call [`Batch::squared_errors`].
    ///
    /// # Errors
    /// Those of that function.
    fn squared_errors(batch: &Batch<'_>, layers: &[Layer<Self>]) -> Result<(Vec<f64>, Vec<usize>)>;
    /// Call [`Batch::gradient`].
    ///
    /// # Errors
    /// Those of that function.
    fn gradient(batch: &Batch<'_>, layers: &[Layer<Self>]) -> Result<Gradient>;
    /// Call [`Batch::normal_equations`].
    ///
    /// # Errors
    /// Those of that function.
    fn normal_equations(batch: &Batch<'_>, layers: &[Layer<Self>]) -> Result<NormalEquations>;
}

macro_rules! compiled {
    ($($float:ty),*) => {$(
        impl Compiled for $float {
            fn forward_planes(
                layers: &[&Layer<Self>],
                sums: ArrayView3<'_, Self>,
                out: ArrayViewMut3<'_, Self>,
            ) -> Result<()> {
                forward::forward_planes(layers, sums, out)
            }
            fn activate(
                splines: &Splines<Self>,
                planes: ArrayView3<'_, Self>,
            ) -> Result<Array3<Self>> {
                splines.activate(planes)
            }
            fn pull_back(
                splines: &Splines<Self>,
                planes: ArrayView3<'_, Self>,
                gradient: ArrayView3<'_, Self>,
            ) -> Result<(Array3<Self>, Array2<f64>)> {
                splines.pull_back(planes, gradient)
            }
            fn squared_errors(
                batch: &Batch<'_>,
                layers: &[Layer<Self>],
            ) -> Result<(Vec<f64>, Vec<usize>)> {
                batch.squared_errors(layers)
            }
            fn gradient(batch: &Batch<'_>, layers: &[Layer<Self>]) -> Result<Gradient> {
                batch.gradient(layers)
            }
            fn normal_equations(
                batch: &Batch<'_>,
                layers: &[Layer<Self>],
            ) -> Result<NormalEquations> {
                batch.normal_equations(layers)
            }
        }
    )*};
}
compiled!(f32, f64);
