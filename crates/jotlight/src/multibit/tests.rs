//! The response at rates and with noise at the ends of their ranges.

use super::*;

#[test]
fn at_an_infinite_rate_all_readings_are_the_largest_one() -> Result<()> {
    for noise in [0.0, 0.3] {
        let response = Response::new(3, noise, 1)?;
        for reading in 0..4 {
            let probability = response.ln_probability(reading, f64::INFINITY).exp();
            let expected = f64::from(u8::from(reading == 3));
            assert_eq!(probability.to_bits(), expected.to_bits());
        }
    }
    Ok(())
}

#[test]
fn functions_of_no_rate_are_not_numbers() -> Result<()> {
    for noise in [0.0, 0.3] {
        let response = Response::new(3, noise, 1)?;
        let table = ScoreTable::new(&response);
        let mut probabilities = [0.0; 4];
        response.write_probabilities(0, f64::NAN, &mut probabilities);
        let (mean, variance, slope) = response.moments(f64::NAN);
        let mut all = vec![mean, variance, slope, response.information(f64::NAN)];
        all.extend(response.information_table().at(f64::NAN));
        all.extend(response.moments_table().at(f64::NAN));
        all.extend(probabilities);
        for reading in 0..4 {
            let derivatives = [
                response.score_and_curvature(reading, f64::NAN),
                table.at(f64::NAN)(reading),
            ];
            all.extend(derivatives.iter().flat_map(|&(one, two)| [one, two]));
            all.push(response.ln_probability(reading, f64::NAN));
        }
        assert!(all.iter().all(|value| value.is_nan()), "{noise}: {all:?}");
    }
    Ok(())
}

#[test]
fn functions_of_huge_rates_are_those_of_an_infinite_one() -> Result<()> {
    let close = |found: f64, limit: f64| (found - limit).abs() < 1e-12;
    for (top, noise) in [(1, 0.0), (3, 0.0), (1, 0.3), (3, 0.3), (3, 5.0)] {
        let response = Response::new(top, noise, 1)?;
        let (information, moments) = (response.information_table(), response.moments_table());
        let table = ScoreTable::new(&response);
        for s in [1e18, 1e40, f64::MAX, f64::INFINITY] {
            for reading in 0..=top {
                let limit = if reading == top { 0.0 } else { -1.0 };
                let direct = response.score_and_curvature(reading, s);
                for (score, curvature) in [direct, table.at(s)(reading)] {
                    let found = format!("{reading} of {top} at {s}: {score}, {curvature}");
                    assert!(close(score, limit) && close(curvature, 0.0), "{found}");
                }
                let probability = response.ln_probability(reading, s).exp();
                assert!(close(probability, 1.0 + limit));
            }
            assert!(close(response.information(s), 0.0));
            assert!(close(information.at(s)[0].exp(), 0.0));
            let (mean, variance, slope) = response.moments(s);
            for [mean, variance, slope] in [[mean, variance, slope], moments.at(s)] {
                assert!(close(mean, f64::from(top)) && close(variance, 0.0));
                assert!(close(slope, 0.0));
            }
        }
    }
    Ok(())
}

#[test]
fn moments_are_sums_over_all_readings() -> Result<()> {
    for noise in [0.0, 0.3, 2.0] {
        for (top, threshold) in [
            (1, 1),
            (1, 2),
            (1, 100),
            (3, 1),
            (3, 100),
            (255, 1),
            (255, 100),
        ] {
            let response = Response::new(top, noise, threshold)?;
            let table = response.moments_table();
            for s in [1e-3, 0.4, 1.0, 20.0, 50.0, 90.0, 100.0, 130.0, 300.0, 700.0] {
                let probability = |reading| response.ln_probability(reading, s).exp();
                let mean: f64 = (1..=top).map(|r| f64::from(r) * probability(r)).sum();
                let distance = |r: u32| (f64::from(r) - mean).powi(2);
                let variance: f64 = (0..=top).map(|r| distance(r) * probability(r)).sum();
                // The score of a reading is d log P/ds.
                let change = |r| response.score_and_curvature(r, s).0 * probability(r);
                let slope: f64 = (1..=top).map(|r| f64::from(r) * change(r)).sum();
                let found = response.moments(s);
                for [mean_found, variance_found, slope_found] in [found.into(), table.at(s)] {
                    let text = format!("noise {noise}, top {top}, q {threshold}, rate {s}");
                    assert!((mean_found - mean).abs() < 1e-7 * (1e-3 + mean), "{text}");
                    assert!(
                        (variance_found - variance).abs() < 1e-7 * (1e-3 + variance),
                        "{text}"
                    );
                    assert!(
                        (slope_found - slope).abs() < 1e-7,
                        "{text}: {slope_found} {slope}"
                    );
                }
                // Relative errors of bits are small too, unless the moments underflow.
                if top == 1 && mean > 0.0 {
                    assert!((found.0 / mean - 1.0).abs() < 1e-9);
                    assert!((found.2 / slope - 1.0).abs() < 1e-9);
                }
            }
        }
    }
    Ok(())
}

#[test]
fn tiny_rates_are_nearly_those_of_no_light() -> Result<()> {
    for noise in [0.05, 0.3, 5.0] {
        let response = Response::new(3, noise, 1)?;
        let (mean, ..) = response.moments(0.0);
        assert!((response.moments(-1.0).0 - mean).abs() < 1e-12);
        for reading in 0..4 {
            let [tiny, none] = [5e-324, 0.0].map(|s| response.ln_probability(reading, s).exp());
            assert!((tiny - none).abs() < 1e-12);
        }
    }
    Ok(())
}

#[test]
fn read_noise_that_changes_no_reading_is_refused() {
    for noise in [-0.1, 1e-200, 9e-4, 100.1, f64::NAN] {
        assert!(Response::new(3, noise, 1).is_err());
    }
}

#[test]
fn tables_can_be_printed() -> Result<()> {
    let response = Response::new(3, 0.3, 1)?;
    assert!(format!("{:?}", response.moments_table()).starts_with("RateTable { nodes: "));
    assert!(format!("{:?}", ScoreTable::new(&response)).starts_with("ScoreTable { response: "));
    Ok(())
}
