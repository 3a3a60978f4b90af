//! Networks with their parameters for every K, and the images that they reconstruct.

use jotlight::bits::PackedBits;
use jotlight::error::{Error, Result};
use jotlight::network::{
    EquivalentCounts, LayerParameters, Network, Pixels, Precision, Reconstruction, SensorModel,
    Served, Wiring, write_images,
};
use jotlight::values::Values;
use ndarray::{ArrayView2, ArrayView3, ArrayViewMut2, Axis};
use numpy::{
    IntoPyArray, PyArray2, PyArray3, PyArrayDyn, PyReadonlyArray2, PyReadonlyArray3,
    PyReadonlyArrayDyn, PyReadwriteArray2,
};
use pyo3::prelude::*;

use super::trials::{PyTrials, to_engine_trials};
use crate::bits::packed_images;
use crate::mle::{PyJotResponse, PyPixelResponse};
use crate::{run, to_python};

/// A layer with sets of parameters, as the tuple (filters, coefficients, first knot, knot spacing,
/// wiring). The wiring is the tuple (stride, upsampling, input, skip).
type PyLayerParameters<'py> = (
    PyReadonlyArrayDyn<'py, f32>,
    Option<PyReadonlyArrayDyn<'py, f32>>,
    f64,
    f64,
    (usize, usize, Option<usize>, Option<usize>),
);

/// The filters and the coefficients of a layer for one K.
type PyParameters<'py> = (
    Bound<'py, PyArrayDyn<f32>>,
    Option<Bound<'py, PyArrayDyn<f32>>>,
);

/// What a network must know about a sensor, as the tuple (K, pixel response, jot).
#[derive(FromPyObject)]
pub struct PySensorModel(u32, PyPixelResponse, PyJotResponse);

impl PySensorModel {
    pub fn to_engine(&self) -> PyResult<SensorModel> {
        Ok(SensorModel {
            trials: self.0,
            response: self.1.to_engine()?,
            jot: self.2.to_engine(),
        })
    }
}

/// A network of the engine, with the layers for the last few K.
#[pyclass(frozen, name = "Network")]
pub struct PyNetwork(Network);

#[pymethods]
impl PyNetwork {
    /// A network for one sensor, or for a range of K, of counts or of planes.
    #[new]
    fn new(
        layers: Vec<PyLayerParameters<'_>>,
        sensor: PySensorModel,
        trials_range: Option<(u32, u32)>,
        reads_planes: bool,
        rotations: usize,
    ) -> PyResult<Self> {
        let served = match trials_range {
            Some((min, max)) if reads_planes => Served::Planes { min, max },
            Some((min, max)) => Served::Trials { min, max },
            None => Served::Sensor(sensor.to_engine()?),
        };
        let layers = layers.iter().map(|layer| {
            let (filters, coefficients, start, spacing, wiring) = layer;
            let &(stride, upsampling, input, skip) = wiring;
            LayerParameters {
                filters: filters.as_array().to_owned(),
                coefficients: coefficients
                    .as_ref()
                    .map(|array| array.as_array().to_owned()),
                start: *start,
                spacing: *spacing,
                wiring: Wiring {
                    stride,
                    upsampling,
                    input,
                    skip,
                },
            }
        });
        let network = Network::new(layers.collect(), served).map_err(to_python)?;
        Ok(Self(network.with_rotations(rotations).map_err(to_python)?))
    }

    /// Return the network with its products in the precision `f32` or `bf16`.
    fn with_precision(&self, precision: &str) -> PyResult<Self> {
        let network = self.0.clone();
        let precision = Precision::named(precision).map_err(to_python)?;
        Ok(Self(network.with_precision(precision).map_err(to_python)?))
    }

    /// The radius of the receptive field in pixels.
    #[getter]
    fn halo(&self) -> usize {
        self.0.halo()
    }

    /// Return whether the network estimates P(b = 0) for a sensor.
    fn estimates_zeros(&self, sensor: PySensorModel) -> PyResult<bool> {
        Ok(self.0.estimates_zeros(&sensor.to_engine()?))
    }

    /// Return the filters and coefficients of all layers for K = `trials`.
    fn conditioned<'py>(
        &self,
        py: Python<'py>,
        trials: f64,
        zeros: bool,
    ) -> PyResult<Vec<PyParameters<'py>>> {
        let layers = self.0.conditioned(trials, zeros).map_err(to_python)?;
        let arrays = layers.into_iter().map(|layer| {
            let coefficients = layer.coefficients.map(|array| array.into_pyarray(py));
            (layer.filters.into_pyarray(py), coefficients)
        });
        Ok(arrays.collect())
    }

    /// Write the images of the bits of each into `out`.
    fn bits(
        &self,
        py: Python<'_>,
        packed: Vec<PyReadonlyArray3<'_, u8>>,
        width: usize,
        oversampling: usize,
        sensor: PySensorModel,
        mut out: Vec<PyReadwriteArray2<'_, f32>>,
        threads: Option<isize>,
    ) -> PyResult<()> {
        let packed = packed.iter().map(PyReadonlyArray3::as_array).collect();
        self.write(
            py,
            packed,
            sensor,
            &mut out,
            threads,
            |reconstruction, packed, out| {
                reconstruction.bits(&PackedBits::new(packed, width)?, oversampling, out)
            },
        )
    }

    /// Write the images of counts `(N, H, W)` into `out`. All pixels have the same trials and jots.
    fn counts(
        &self,
        py: Python<'_>,
        counts: PyReadonlyArray3<'_, i32>,
        trials: f64,
        jot: PyJotResponse,
        sensor: PySensorModel,
        mut out: Vec<PyReadwriteArray2<'_, f32>>,
        threads: Option<isize>,
    ) -> PyResult<()> {
        let counts = counts.as_array();
        let counts: Vec<ArrayView2<'_, i32>> = counts.axis_iter(Axis(0)).collect();
        let jots = jot.to_all();
        self.write(
            py,
            counts,
            sensor,
            &mut out,
            threads,
            |reconstruction, counts, out| {
                let pixels = Pixels {
                    counts,
                    trials: Values::Same(trials),
                    jots,
                };
                reconstruction.pixels(&pixels, out)
            },
        )
    }

    /// Write the images of counts that equal jots would show among `of` bits into `out`.
    fn equivalent_counts(
        &self,
        py: Python<'_>,
        counts: PyReadonlyArray3<'_, f32>,
        of: Vec<u32>,
        trials: Vec<PyTrials<'_>>,
        sensor: PySensorModel,
        mut out: Vec<PyReadwriteArray2<'_, f32>>,
        threads: Option<isize>,
    ) -> PyResult<()> {
        let (counts, sensor) = (counts.as_array(), sensor.to_engine()?);
        let number = counts.len_of(Axis(0));
        for (what, length) in [("of", of.len()), ("trials", trials.len())] {
            if length != number {
                return Err(to_python(Error::Shape {
                    what,
                    expected: number.to_string(),
                    received: length.to_string(),
                }));
            }
        }
        let images = counts.axis_iter(Axis(0)).zip(of);
        let images = images.zip(to_engine_trials(&trials));
        let images = images.map(|((counts, of), trials)| EquivalentCounts { counts, of, trials });
        let images: Vec<_> = images.collect();
        let out = out.iter_mut().map(|out| out.as_array_mut()).collect();
        run(py, threads, || {
            self.0.prepare(sensor)?.equivalent_counts(&images, out)
        })
    }

    /// Return the sums p of the first layer from the bits of each image, whose dead jots are the
    /// same.
    fn masked_sums<'py>(
        &self,
        py: Python<'py>,
        packed: Vec<PyReadonlyArray3<'_, u8>>,
        width: usize,
        valid: PyReadonlyArray2<'_, u8>,
        threads: Option<isize>,
    ) -> PyResult<Vec<Bound<'py, PyArray3<f32>>>> {
        let (images, valid) = (packed_images(&packed, width)?, valid.as_array());
        let sums = run(py, threads, || self.0.masked_sums(&images, valid))?;
        Ok(sums.into_iter().map(|sums| sums.into_pyarray(py)).collect())
    }

    /// Write the images of the sums of the first layer, `(C, H, W)` each, into `out`.
    fn sums(
        &self,
        py: Python<'_>,
        sums: Vec<PyReadonlyArray3<'_, f32>>,
        sensor: PySensorModel,
        mut out: Vec<PyReadwriteArray2<'_, f32>>,
        threads: Option<isize>,
    ) -> PyResult<()> {
        let sums: Vec<ArrayView3<'_, f32>> = sums.iter().map(PyReadonlyArray3::as_array).collect();
        self.write(
            py,
            sums,
            sensor,
            &mut out,
            threads,
            |reconstruction, sums, out| reconstruction.sums(sums, out),
        )
    }

    /// Return the outputs of the last layer for images of counts among K = `trials` bits.
    fn run_counts<'py>(
        &self,
        py: Python<'py>,
        counts: Vec<PyReadonlyArray2<'_, f32>>,
        trials: u32,
        zeros: bool,
        threads: Option<isize>,
    ) -> PyResult<Vec<Bound<'py, PyArray2<f32>>>> {
        let counts: Vec<_> = counts
            .iter()
            .map(|counts| counts.as_array().to_owned())
            .collect();
        let out = run(py, threads, || self.0.run_counts(counts, trials, zeros))?;
        Ok(out.into_iter().map(|out| out.into_pyarray(py)).collect())
    }

    /// Return the probabilities from fractions of ones, or of zeros, and the local trials.
    fn denoise<'py>(
        &self,
        py: Python<'py>,
        fractions: Vec<PyReadonlyArray2<'_, f32>>,
        trials: Vec<PyTrials<'_>>,
        zeros: bool,
        threads: Option<isize>,
    ) -> PyResult<Vec<Bound<'py, PyArray2<f32>>>> {
        let fractions: Vec<_> = fractions.iter().map(PyReadonlyArray2::as_array).collect();
        let trials = to_engine_trials(&trials);
        let out = run(py, threads, || self.0.denoise(&fractions, &trials, zeros))?;
        Ok(out.into_iter().map(|out| out.into_pyarray(py)).collect())
    }

    /// Return the outputs `(C, H, W)` of a network for planes `(P, H, W)`.
    fn improve<'py>(
        &self,
        py: Python<'py>,
        planes: PyReadonlyArray3<'_, f32>,
        trials: f64,
        threads: Option<isize>,
    ) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let planes = planes.as_array();
        let out = run(py, threads, || self.0.improve(planes, trials))?;
        Ok(out.into_pyarray(py))
    }
}

impl PyNetwork {
    /// Run `evaluate` without the GIL for each input, which writes an image.
    fn write<Input: Send>(
        &self,
        py: Python<'_>,
        inputs: Vec<Input>,
        sensor: PySensorModel,
        out: &mut [PyReadwriteArray2<'_, f32>],
        threads: Option<isize>,
        evaluate: impl Fn(&Reconstruction<'_>, Input, ArrayViewMut2<'_, f32>) -> Result<()>
        + Send
        + Sync,
    ) -> PyResult<()> {
        let sensor = sensor.to_engine()?;
        let out: Vec<_> = out.iter_mut().map(|out| out.as_array_mut()).collect();
        run(py, threads, || {
            let reconstruction = self.0.prepare(sensor)?;
            write_images(inputs, out, |input, out| {
                evaluate(&reconstruction, input, out)
            })
        })
    }
}
