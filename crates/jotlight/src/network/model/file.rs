//! Networks in `.safetensors` files, as `jotlight.Network.save` writes them.

use std::path::Path;

use ndarray::ArrayD;
use safetensors::{Dtype, SafeTensors};
use serde::Deserialize;

use super::{LayerParameters, Network, SensorModel, Served};
use crate::error::{Error, Result};
use crate::likelihood::Threshold;
use crate::mle::{JotResponse, PixelResponse};
use crate::network::layer::Wiring;
use crate::numbers::median;

const FORMAT: &str = "jotlight network";
const VERSION: &str = "3";

/// The metadata of a layer.
#[derive(Deserialize)]
struct LayerFields {
    start: Option<f64>,
    spacing: Option<f64>,
    stride: usize,
    upsampling: usize,
    input: Option<usize>,
    skip: Option<usize>,
}

/// The metadata of a sensor. A parameter that is a map is not among them: a tensor holds it.
#[derive(Deserialize)]
struct SensorFields {
    oversampling: u32,
    frames: u32,
    gain: f64,
    threshold: Option<u32>,
    dark_counts: Option<f64>,
    efficiency: Option<f64>,
    max_intensity: f64,
}

impl Network {
    /// Return the network in a `.safetensors` file. No code in the file is executed.
    ///
    /// # Errors
    /// [`Error::File`] if the file cannot be read or is not a network file, and the errors of
    /// [`Network::new`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let content = std::fs::read(path).map_err(|error| Error::File {
            name: path.display().to_string(),
            reason: error.to_string(),
        })?;
        Self::from_bytes(&path.display().to_string(), &content)
    }

    /// Return the network in the content of a `.safetensors` file. Errors state its `name`.
    ///
    /// # Errors
    /// Those of [`Network::load`].
    pub fn from_bytes(name: &str, content: &[u8]) -> Result<Self> {
        let file = File { name };
        let (_, metadata) = SafeTensors::read_metadata(content).map_err(|e| file.error(e))?;
        let tensors = SafeTensors::deserialize(content).map_err(|e| file.error(e))?;
        let metadata = metadata.metadata().clone().unwrap_or_default();
        let entry = |key: &str| {
            let entry = metadata.get(key).map(String::as_str);
            entry.ok_or_else(|| file.error(format!("expected the metadata {key}, got none")))
        };
        for (key, expected) in [("format", FORMAT), ("version", VERSION)] {
            let received = entry(key)?;
            if received != expected {
                return Err(file.error(format!("expected {key} {expected}, got {received}")));
            }
        }
        // The files of most shipped networks were written before these numbers existed.
        let rotations = metadata.get("rotations").map_or("1", String::as_str);
        let rotations = serde_json::from_str(rotations).map_err(|e| file.error(e))?;
        let planes = metadata.get("planes").map_or("0", String::as_str);
        let planes: usize = serde_json::from_str(planes).map_err(|e| file.error(e))?;
        let layers: Vec<LayerFields> =
            serde_json::from_str(entry("layers")?).map_err(|e| file.error(e))?;
        let layers: Result<Vec<_>> = layers
            .iter()
            .enumerate()
            .map(|(index, fields)| file.layer(&tensors, index, fields))
            .collect();
        let range: Option<(u32, u32)> =
            serde_json::from_str(entry("trials_range")?).map_err(|e| file.error(e))?;
        let layers = layers?;
        let served = match range {
            Some((min, max)) if planes > 0 => Served::Planes { min, max },
            Some((min, max)) => Served::Trials { min, max },
            None => file.sensor(&tensors, entry("sensor")?)?,
        };
        Self::new(layers, served)?.with_rotations(rotations)
    }
}

/// A file, for messages.
struct File<'a> {
    name: &'a str,
}

impl File<'_> {
    fn error(&self, reason: impl ToString) -> Error {
        Error::File {
            name: self.name.to_owned(),
            reason: reason.to_string(),
        }
    }

    fn layer(
        &self,
        tensors: &SafeTensors<'_>,
        index: usize,
        fields: &LayerFields,
    ) -> Result<LayerParameters> {
        let coefficients = match fields.start {
            Some(_) => Some(self.array(tensors, &format!("layers.{index}.coefficients"))?),
            None => None,
        };
        Ok(LayerParameters {
            filters: self.array(tensors, &format!("layers.{index}.filters"))?,
            coefficients,
            start: fields.start.unwrap_or(0.0),
            spacing: fields.spacing.unwrap_or(1.0),
            wiring: Wiring {
                stride: fields.stride,
                upsampling: fields.upsampling,
                input: fields.input,
                skip: fields.skip,
            },
        })
    }

    fn sensor(&self, tensors: &SafeTensors<'_>, json: &str) -> Result<Served> {
        let fields: SensorFields = serde_json::from_str(json).map_err(|e| self.error(e))?;
        let jots = fields.oversampling.checked_mul(fields.oversampling);
        let trials = jots.and_then(|jots| jots.checked_mul(fields.frames));
        let trials = trials.ok_or_else(|| self.error("more than 2^32 trials per pixel"))?;
        let threshold = fields.threshold.ok_or_else(|| {
            self.error(
                "threshold: expected one number, got a map of the jots, which no network serves",
            )
        })?;
        Ok(Served::Sensor(SensorModel {
            trials,
            response: PixelResponse {
                threshold: Threshold::new(threshold)?,
                light_per_intensity: fields.gain / f64::from(trials),
                max_intensity: fields.max_intensity,
            },
            jot: JotResponse {
                efficiency: self.of_median_jot(tensors, "efficiency", fields.efficiency)?,
                dark_counts: self.of_median_jot(tensors, "dark_counts", fields.dark_counts)?,
            },
        }))
    }

    /// Return a parameter of the sensor: its number, or the median of its map over the live jots.
    fn of_median_jot(
        &self,
        tensors: &SafeTensors<'_>,
        name: &str,
        number: Option<f64>,
    ) -> Result<f64> {
        if let Some(number) = number {
            return Ok(number);
        }
        let map = self.array(tensors, &format!("sensor.{name}"))?;
        let mut live: Vec<f32> = match tensors.tensor("sensor.mask") {
            Ok(mask) if (mask.dtype(), mask.shape()) != (Dtype::BOOL, map.shape()) => {
                let (expected, dtype, received) = (map.shape(), mask.dtype(), mask.shape());
                return Err(self.error(format!(
                    "sensor.mask: expected BOOL of shape {expected:?}, got {dtype:?} of {received:?}"
                )));
            }
            Ok(mask) if mask.data().contains(&0) => {
                let jots = map.iter().zip(mask.data());
                jots.filter_map(|(&value, &dead)| (dead == 0).then_some(value))
                    .collect()
            }
            // All jots are dead, or none is.
            _ => map.iter().copied().collect(),
        };
        let middle = median(&mut live);
        let middle = middle.ok_or_else(|| self.error(format!("sensor.{name}: expected jots")))?;
        Ok(middle.into())
    }

    /// Return an array of `f32`, whose numbers may be stored in 16 bits.
    fn array(&self, tensors: &SafeTensors<'_>, name: &str) -> Result<ArrayD<f32>> {
        let tensor = tensors.tensor(name).map_err(|e| self.error(e))?;
        let data = tensor.data();
        let values: Vec<f32> = match tensor.dtype() {
            Dtype::F32 => data
                .as_chunks()
                .0
                .iter()
                .map(|&x| f32::from_le_bytes(x))
                .collect(),
            Dtype::F16 => {
                let halves = data.as_chunks().0.iter();
                halves.map(|&x| from_half(u16::from_le_bytes(x))).collect()
            }
            other => {
                let message = format!("{name}: expected float32 or float16, got {other:?}");
                return Err(self.error(message));
            }
        };
        ArrayD::from_shape_vec(tensor.shape(), values).map_err(|e| self.error(e))
    }
}

/// Return a number with 1 sign bit, 5 bits of the exponent, and 10 of the fraction.
fn from_half(bits: u16) -> f32 {
    let (exponent, fraction) = (bits >> 10 & 0x1f, f32::from(bits & 0x3ff));
    let magnitude = match exponent {
        0 => fraction * 2f32.powi(-24),
        0x1f if fraction == 0.0 => f32::INFINITY,
        0x1f => f32::NAN,
        _ => (1.0 + fraction / 1024.0) * 2f32.powi(i32::from(exponent) - 15),
    };
    if bits >> 15 == 1 {
        -magnitude
    } else {
        magnitude
    }
}

#[cfg(test)]
mod tests {
    use safetensors::tensor::TensorView;

    use super::*;

    /// Return the content of the file of a network for one K, whose sensor has maps.
    fn network_with_maps(sensor: &str, tensors: &[(&str, TensorView<'_>)]) -> Vec<u8> {
        let metadata = [
            ("format", FORMAT),
            ("version", VERSION),
            ("layers", r#"[{"stride": 1, "upsampling": 1}]"#),
            ("trials_range", "null"),
            ("sensor", sensor),
        ];
        let metadata = metadata.map(|(key, value)| (key.to_owned(), value.to_owned()));
        let tensors = tensors.iter().cloned();
        safetensors::serialize(tensors, Some(metadata.into())).unwrap_or_default()
    }

    #[test]
    fn the_median_of_the_live_jots_replaces_the_maps_of_a_sensor() -> Result<()> {
        let bytes = |values: &[f32]| -> Vec<u8> {
            values
                .iter()
                .flat_map(|value| value.to_le_bytes())
                .collect()
        };
        let (filter, dark_counts) = (bytes(&[0.1]), bytes(&[0.5, 9.0, 0.25, 0.125]));
        let tensor = |dtype, shape: &[usize], data| {
            TensorView::new(dtype, shape.to_vec(), data).map_err(|error| Error::File {
                name: "network".to_owned(),
                reason: error.to_string(),
            })
        };
        let filters = (
            "layers.0.filters",
            tensor(Dtype::F32, &[1, 1, 1, 1], &filter)?,
        );
        let map = (
            "sensor.dark_counts",
            tensor(Dtype::F32, &[2, 2], &dark_counts)?,
        );
        let mask = |dead| Ok(("sensor.mask", tensor(Dtype::BOOL, &[2, 2], dead)?));
        let numbers = r#"{"oversampling": 1, "frames": 16, "gain": 16.0, "threshold": 1,
            "efficiency": 0.5, "max_intensity": 1.0}"#;
        let dark_counts_of = |tensors: &[_]| {
            let network = Network::from_bytes("network", &network_with_maps(numbers, tensors))?;
            match network.served() {
                Served::Sensor(sensor) => Ok(sensor.jot.dark_counts),
                other => Err(Error::range("served", "a sensor", format!("{other:?}"))),
            }
        };
        let tensors = [filters.clone(), map.clone()];
        assert_eq!(dark_counts_of(&tensors)?.to_bits(), f64::to_bits(0.375));
        for (dead, expected) in &[([0, 1, 0, 0], 0.25), ([0; 4], 0.375), ([1; 4], 0.375)] {
            let tensors = [filters.clone(), map.clone(), mask(dead)?];
            assert_eq!(dark_counts_of(&tensors)?.to_bits(), f64::to_bits(*expected));
        }
        let error =
            dark_counts_of(std::slice::from_ref(&filters)).map_err(|error| error.to_string());
        assert!(error.is_err_and(|text| text.contains("sensor.dark_counts")));
        let numbers = numbers.replace(r#""threshold": 1,"#, "");
        let content = network_with_maps(&numbers, &tensors);
        let error = Network::from_bytes("network", &content).map_err(|error| error.to_string());
        assert!(error.is_err_and(|text| text.contains("threshold: expected one number")));
        Ok(())
    }

    #[test]
    fn halves_are_exact() {
        let pairs = [
            (0x0000, 0.0),
            (0x0001, 5.960_464_5e-8),
            (0x03ff, 6.097_555e-5),
            (0x0400, 6.103_515_6e-5),
            (0x3555, 0.333_251_95),
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
        ];
        for (bits, expected) in pairs {
            assert_eq!(from_half(bits).to_bits(), f32::to_bits(expected));
        }
        assert!(from_half(0x7c00).is_infinite() && from_half(0x7e00).is_nan());
    }

    #[test]
    fn other_files_are_refused() {
        for content in [&b""[..], b"12345678", b"\x02\0\0\0\0\0\0\0{}"] {
            let result = Network::from_bytes("other", content);
            assert!(matches!(result, Err(Error::File { name, .. }) if name == "other"));
        }
        let result = Network::load("missing.safetensors");
        assert!(matches!(result, Err(Error::File { .. })));
    }
}
