//! Probabilities, information, and moments of readings at many rates.

use rayon::prelude::*;

use super::Response;
use crate::error::{Result, check_shape};
use crate::{elements, interrupt};

/// The number of rates per task.
const RATES_PER_TASK: usize = 16;

impl Response {
    /// Write log P(R = reading) of each reading at its rate into `out`.
    ///
    /// # Errors
    /// [`Error::Shape`](crate::error::Error::Shape) if the lengths do not match.
    pub fn ln_probabilities(&self, readings: &[i32], rates: &[f64], out: &mut [f64]) -> Result<()> {
        check_shape("rates", readings.len(), rates.len())?;
        check_shape("out", readings.len(), out.len())?;
        elements::write(out, RATES_PER_TASK, |index| {
            let reading = readings[index].max(0).cast_unsigned();
            self.ln_probability(reading, rates[index])
        });
        Ok(())
    }

    /// Write P(R = r) for r = 0, 1, … at each rate into `out` `(rates, length)`, as
    /// [`Self::write_probabilities`] does.
    ///
    /// # Errors
    /// [`Error::Shape`](crate::error::Error::Shape) if the lengths do not match.
    pub fn distributions(&self, rates: &[f64], length: usize, out: &mut [f64]) -> Result<()> {
        check_shape("out", rates.len() * length, out.len())?;
        let rows = out.par_chunks_mut(length.max(1)).zip(rates);
        rows.for_each(|(row, &rate)| {
            if !interrupt::is_requested() {
                self.write_probabilities(0, rate, row);
            }
        });
        Ok(())
    }

    /// Write the Fisher information of a reading about each rate into `out`.
    ///
    /// # Errors
    /// [`Error::Shape`](crate::error::Error::Shape) if the lengths do not match.
    pub fn informations(&self, rates: &[f64], out: &mut [f64]) -> Result<()> {
        check_shape("out", rates.len(), out.len())?;
        let table = self.information_table();
        elements::write(out, RATES_PER_TASK, |index| table.at(rates[index])[0].exp());
        Ok(())
    }

    /// Write the mean of a reading, its variance, and the derivative of the mean at each rate into
    /// `out`.
    ///
    /// # Errors
    /// [`Error::Shape`](crate::error::Error::Shape) if the lengths do not match.
    pub fn all_moments(&self, rates: &[f64], out: &mut [[f64; 3]]) -> Result<()> {
        check_shape("out", rates.len(), out.len())?;
        let table = self.moments_table();
        elements::write(out, RATES_PER_TASK, |index| {
            let [mean, variance, slope] = table.at(rates[index]);
            // Interpolation can make a vanishing variance negative.
            let variance = if variance < 0.0 { 0.0 } else { variance };
            [mean, variance, slope]
        });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_at_many_rates_are_those_at_single_ones() -> Result<()> {
        let response = Response::new(15, 0.4, 1)?;
        let rates: Vec<f64> = (0..600).map(|index| 0.05 * f64::from(index)).collect();
        let readings: Vec<i32> = (0..600).map(|index| index % 16).collect();
        let mut logarithms = vec![f64::NAN; 600];
        response.ln_probabilities(&readings, &rates, &mut logarithms)?;
        let mut probabilities = vec![f64::NAN; 600 * 16];
        response.distributions(&rates, 16, &mut probabilities)?;
        let mut informations = vec![f64::NAN; 600];
        response.informations(&rates, &mut informations)?;
        let mut moments = vec![[f64::NAN; 3]; 600];
        response.all_moments(&rates, &mut moments)?;
        for (index, row) in probabilities.chunks_exact(16).enumerate() {
            let (reading, rate) = (readings[index] as u32, rates[index]);
            let exact = response.ln_probability(reading, rate);
            assert_eq!(logarithms[index].to_bits(), exact.to_bits());
            assert!((row[reading as usize] - exact.exp()).abs() < 1e-13);
            let exact = response.information(rate);
            assert!(
                (informations[index] - exact).abs() <= 1e-6 * exact,
                "{rate}"
            );
            let (mean, variance, slope) = response.moments(rate);
            for (found, exact) in moments[index].iter().zip([mean, variance, slope]) {
                assert!((found - exact).abs() <= 1e-6 * (1.0 + exact), "{rate}");
            }
        }
        Ok(())
    }

    #[test]
    fn other_lengths_are_refused() -> Result<()> {
        let response = Response::new(3, 0.0, 1)?;
        let mut out = [0.0; 2];
        assert!(
            response
                .ln_probabilities(&[1, 2], &[0.1], &mut out)
                .is_err()
        );
        assert!(response.ln_probabilities(&[1], &[0.1], &mut out).is_err());
        assert!(response.distributions(&[0.1], 3, &mut out).is_err());
        assert!(response.informations(&[0.1], &mut out).is_err());
        assert!(response.all_moments(&[0.1], &mut [[0.0; 3]; 2]).is_err());
        Ok(())
    }
}
