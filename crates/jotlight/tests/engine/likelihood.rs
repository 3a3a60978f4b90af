//! Comparisons of the log-likelihood, its derivatives, and its proximal map with their definitions.

use jotlight::admm::AdmmStep;
use jotlight::error::{Error, Result};
use jotlight::likelihood::{Readings, Threshold};
use jotlight::threads;
use jotlight::values::Values;

/// The arrays of readings. The numbers differ from element to element.
struct Data {
    ones: Vec<i32>,
    trials: Vec<f64>,
    efficiency: Vec<f64>,
    dark_counts: Vec<f64>,
    light: Vec<f64>,
}

impl Data {
    fn new(length: usize) -> Self {
        let whole: Vec<i32> = (0..length).map(|i| (i % 10) as i32).collect();
        Self {
            ones: (0..length)
                .map(|i| (i * 7) as i32 % (whole[i] + 1))
                .collect(),
            efficiency: (0..length).map(|i| 0.3 + 0.07 * (i % 11) as f64).collect(),
            dark_counts: (0..length).map(|i| 0.02 * (i % 4) as f64).collect(),
            light: (0..length).map(|i| 0.05 + 0.31 * (i % 13) as f64).collect(),
            trials: whole.iter().map(|&n| f64::from(n) + 0.3).collect(),
        }
    }

    fn readings(&self, q: u32) -> Result<Readings<'_>> {
        Readings::new(
            Threshold::new(q)?,
            &self.ones,
            Values::Each(&self.trials),
            Values::Each(&self.efficiency),
            Values::Each(&self.dark_counts),
        )
    }

    /// Return the data of a single element.
    fn element(&self, index: usize) -> Self {
        Self {
            ones: vec![self.ones[index]],
            trials: vec![self.trials[index]],
            efficiency: vec![self.efficiency[index]],
            dark_counts: vec![self.dark_counts[index]],
            light: vec![self.light[index]],
        }
    }
}

#[test]
fn the_value_is_a_sum_of_logarithms() -> Result<()> {
    let data = Data::new(100);
    for q in [1, 2, 6] {
        let threshold = Threshold::new(q)?;
        let expected: f64 = (0..100)
            .map(|i| {
                let rate = data.efficiency[i] * data.light[i] + data.dark_counts[i];
                let ones = f64::from(data.ones[i]);
                let zeros = data.trials[i] - ones;
                ones * threshold.detection_probability(rate).ln()
                    + zeros * threshold.non_detection_probability(rate).ln()
            })
            .sum();
        let value = data.readings(q)?.value(&data.light)?;
        assert!((value - expected).abs() < 1e-9 * expected.abs(), "q = {q}");
    }
    Ok(())
}

#[test]
fn the_parts_of_readings_have_their_own_values() -> Result<()> {
    let data = Data::new(30);
    for q in [1, 2] {
        let readings = data.readings(q)?;
        for (start, end) in [(0, 30), (0, 7), (7, 8), (8, 30), (5, 5)] {
            let part = readings.part(start..end);
            assert_eq!(part.len(), end - start);
            let expected: Result<f64> = (start..end)
                .map(|i| data.element(i).readings(q)?.value(&data.light[i..=i]))
                .sum();
            let value = part.value(&data.light[start..end])?;
            assert!((value - expected?).abs() <= 1e-12 * value.abs());
        }
    }
    Ok(())
}

#[test]
fn gradient_and_curvature_agree_with_finite_differences() -> Result<()> {
    let data = Data::new(130);
    for q in [1, 2, 6] {
        let (mut gradient, mut curvature) = ([0.0; 130], [0.0; 130]);
        let readings = data.readings(q)?;
        readings.gradient_and_curvature(&data.light, &mut gradient, &mut curvature)?;
        for index in 0..130 {
            let element = data.element(index);
            let readings = element.readings(q)?;
            let step = 1e-4 * element.light[0];
            let value = |light: f64| readings.value(&[light]);
            let [below, here, above] =
                [-1.0, 0.0, 1.0].map(|side| value(element.light[0] + side * step));
            let (below, here, above) = (below?, here?, above?);
            let first = (above - below) / (2.0 * step);
            let second = -((above - here) - (here - below)) / (step * step);
            let scale = first.abs() + 1.0;
            assert!(
                (gradient[index] - first).abs() < 1e-5 * scale,
                "q = {q}, {index}"
            );
            let scale = second.abs() + first.abs() / element.light[0] + 1.0;
            assert!(
                (curvature[index] - second).abs() < 1e-3 * scale,
                "q = {q}, {index}"
            );
            assert!(curvature[index] >= 0.0);
        }
    }
    Ok(())
}

#[test]
fn vector_code_for_one_photon_agrees_with_the_threshold() -> Result<()> {
    let data = Data::new(5000);
    let threshold = Threshold::new(1)?;
    let (mut gradient, mut curvature) = (vec![0.0; 5000], vec![0.0; 5000]);
    let readings = data.readings(1)?;
    readings.gradient_and_curvature(&data.light, &mut gradient, &mut curvature)?;
    for i in 0..5000 {
        let rate = data.efficiency[i] * data.light[i] + data.dark_counts[i];
        let ones = f64::from(data.ones[i]);
        let zeros = data.trials[i] - ones;
        let (score, concavity) = threshold.detection_score_and_curvature(rate);
        let expected = data.efficiency[i] * (ones * score - zeros);
        assert!((gradient[i] - expected).abs() < 1e-12 * (1.0 + ones * score));
        let expected = data.efficiency[i].powi(2) * ones * concavity;
        assert!((curvature[i] - expected).abs() <= 1e-12 * expected);
    }
    Ok(())
}

#[test]
fn information_is_the_expected_curvature() -> Result<()> {
    // A binomial count has the expectation n P. The expected curvature is therefore a sum of the
    // curvatures for ones and for zeros, with the weights n P and n (1 − P).
    let data = Data::new(60);
    for q in [1, 3] {
        let threshold = Threshold::new(q)?;
        let mut information = [0.0; 60];
        data.readings(q)?
            .information(&data.light, &mut information)?;
        for i in 0..60 {
            let rate = data.efficiency[i] * data.light[i] + data.dark_counts[i];
            let curvature_of_ones = threshold.detection_score_and_curvature(rate).1;
            let curvature_of_zeros = threshold.non_detection_score_and_curvature(rate).1;
            let expected = data.trials[i]
                * data.efficiency[i].powi(2)
                * (threshold.detection_probability(rate) * curvature_of_ones
                    + threshold.non_detection_probability(rate) * curvature_of_zeros);
            assert!((information[i] - expected).abs() <= 1e-9 * (expected + 1e-9));
        }
    }
    Ok(())
}

#[test]
fn the_proximal_map_minimizes_the_objective() -> Result<()> {
    let (data, max_light) = (Data::new(200), 3.0);
    for q in [1, 2, 6] {
        for penalty in [0.01, 1.0, 1e4] {
            let points: Vec<f64> = (0..200).map(|i| -1.0 + 0.03 * f64::from(i)).collect();
            let mut minimizers = points.clone();
            let readings = data.readings(q)?;
            readings.proximal(penalty, max_light, &data.light, &mut minimizers)?;
            for (index, (&x, point)) in minimizers.iter().zip(points).enumerate() {
                assert!((0.0..=max_light).contains(&x));
                let element = data.element(index);
                let readings = element.readings(q)?;
                let objective = |x: f64| -> Result<f64> {
                    Ok(0.5 * penalty * (x - point).powi(2) - readings.value(&[x])?)
                };
                let minimum = objective(x)?;
                for other in [x - 1e-3, x + 1e-3, 0.0, 0.5 * max_light, max_light] {
                    let other = objective(other.clamp(0.0, max_light))?;
                    let rounding = 1e-9 * (1.0 + minimum.abs());
                    assert!(
                        other >= minimum - rounding,
                        "q = {q}, ρ = {penalty}, {index}"
                    );
                }
            }
        }
    }
    Ok(())
}

#[test]
fn an_admm_update_is_a_proximal_map_and_a_dual_step() -> Result<()> {
    let (data, max_light) = (Data::new(150), 4.0);
    let step = AdmmStep {
        penalty: 2.0,
        relaxation: 1.6,
    };
    for q in [1, 3] {
        let readings = data.readings(q)?;
        let (mut x, mut dual) = (vec![0.7; 150], vec![0.1; 150]);
        let relaxed = |light: f64| 1.6 * light - 0.6 * 0.7 + 0.1;
        let points: Vec<f64> = data.light.iter().copied().map(relaxed).collect();
        let mut expected = points.clone();
        readings.proximal(step.penalty, max_light, &x, &mut expected)?;
        let residuals = readings.admm_update(&[step], max_light, &data.light, &mut x, &mut dual)?;
        let mut sum = 0.0;
        for i in 0..150 {
            assert!((x[i] - expected[i]).abs() < 1e-5, "q = {q}, {i}");
            assert!((dual[i] - (points[i] - x[i])).abs() < 1e-12);
            sum += (data.light[i] - x[i]).powi(2);
        }
        assert!((residuals[0] - sum).abs() < 1e-9 * sum);
    }
    Ok(())
}

#[test]
fn the_images_of_a_stack_are_independent() -> Result<()> {
    let data = Data::new(150);
    let steps = [2.0, 0.5, 7.0].map(|penalty| AdmmStep {
        penalty,
        relaxation: 1.6,
    });
    for q in [1, 3] {
        let readings = data.readings(q)?;
        let values = readings.values(3, &data.light)?;
        let (mut x, mut dual) = (vec![0.7; 150], vec![0.1; 150]);
        let residuals = readings.admm_update(&steps, 4.0, &data.light, &mut x, &mut dual)?;
        for image in 0..3 {
            let elements = 50 * image..50 * (image + 1);
            let (part, light) = (
                readings.part(elements.clone()),
                &data.light[elements.clone()],
            );
            assert_eq!(part.value(light)?.to_bits(), values[image].to_bits());
            let (mut own_x, mut own_dual) = (vec![0.7; 50], vec![0.1; 50]);
            let own = &steps[image..=image];
            let residual = part.admm_update(own, 4.0, light, &mut own_x, &mut own_dual)?;
            assert_eq!(residual[0].to_bits(), residuals[image].to_bits());
            assert_eq!(
                (&own_x[..], &own_dual[..]),
                (&x[elements.clone()], &dual[elements])
            );
        }
        assert!(readings.values(4, &data.light).is_err());
    }
    Ok(())
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() -> Result<()> {
    let data = Data::new(20_000);
    for q in [1, 2] {
        let run = |threads| {
            threads::install(Some(threads), || -> Result<(u64, Vec<u64>)> {
                let readings = data.readings(q)?;
                let mut point = data.light.clone();
                readings.proximal(0.5, 4.0, &data.light, &mut point)?;
                let value = readings.value(&point)?.to_bits();
                Ok((value, point.into_iter().map(f64::to_bits).collect()))
            })?
        };
        let one = run(1)?;
        assert_eq!(run(2)?, one);
        assert_eq!(run(5)?, one);
    }
    Ok(())
}

#[test]
fn invalid_arguments_are_errors() -> Result<()> {
    let threshold = Threshold::new(1)?;
    let readings = |ones, trials, efficiency| {
        Readings::new(threshold, ones, trials, efficiency, Values::Same(0.0)).map(|_| ())
    };
    let name = |result: Result<()>| match result {
        Err(Error::Shape { what, .. } | Error::Range { what, .. }) => what,
        _ => "no error of shape or range",
    };
    let one = Values::Same(1.0);
    assert_eq!(name(readings(&[0, 3], Values::Same(2.0), one)), "counts");
    assert_eq!(name(readings(&[-1], Values::Same(2.0), one)), "counts");
    assert_eq!(
        name(readings(&[0], Values::Each(&[1.0, 1.0]), one)),
        "trials"
    );
    for trials in [f64::NAN, f64::INFINITY] {
        assert_eq!(name(readings(&[0], Values::Same(trials), one)), "trials");
    }
    let efficiency = Values::Each(&[1.0; 3][..]);
    assert_eq!(
        name(readings(&[0], Values::Same(1.0), efficiency)),
        "efficiency"
    );

    let data = Data::new(3);
    let readings = data.readings(1)?;
    assert_eq!(name(readings.value(&[1.0]).map(|_| ())), "light");
    let (all, few) = ([1.0; 3], [1.0; 2]);
    let (mut point, mut out, mut short) = ([1.0; 3], [0.0; 3], [0.0; 2]);
    let derivatives = readings.gradient_and_curvature(&all, &mut short, &mut out);
    assert_eq!(name(derivatives), "gradient");
    let derivatives = readings.gradient_and_curvature(&all, &mut out, &mut short);
    assert_eq!(name(derivatives), "curvature");
    assert_eq!(name(readings.information(&all, &mut short)), "information");
    let refused = readings.proximal(1.0, 1.0, &few, &mut point);
    assert_eq!(name(refused), "guess");
    let refused = readings.proximal(1.0, 1.0, &all, &mut short);
    assert_eq!(name(refused), "point");
    let update = |x: &mut [f64], dual: &mut [f64]| {
        let step = AdmmStep {
            penalty: 1.0,
            relaxation: 1.5,
        };
        readings.admm_update(&[step], 1.0, &all, x, dual)
    };
    assert_eq!(name(update(&mut short, &mut out).map(|_| ())), "x");
    assert_eq!(name(update(&mut out, &mut short).map(|_| ())), "dual");
    for penalty in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let refused = readings.proximal(penalty, 1.0, &[1.0; 3], &mut point);
        assert_eq!(name(refused), "penalty");
    }
    Ok(())
}
