//! Comparisons of P(b = 1), its derivatives, scores, and inverse with their definitions.

use jotlight::error::{Error, Result};
use jotlight::likelihood::Threshold;

const THRESHOLDS: [u32; 6] = [1, 2, 3, 5, 20, 100];
const RATES: [f64; 12] = [
    1e-9, 1e-4, 0.01, 0.3, 1.0, 2.5, 4.999, 5.0, 19.0, 60.0, 100.5, 150.0,
];

/// Return P(Y < q) as the sum of Poisson probabilities.
fn poisson_below(q: u32, s: f64) -> f64 {
    let mut term = (-s).exp();
    let mut sum = 0.0;
    for k in 0..q {
        sum += term;
        term *= s / f64::from(k + 1);
    }
    sum
}

fn assert_close(value: f64, expected: f64, relative: f64, what: &str) {
    let error = (value - expected).abs();
    assert!(
        error <= relative * expected.abs(),
        "{what}: {value} instead of {expected}"
    );
}

#[test]
fn both_probabilities_are_sums_of_poisson_terms() -> Result<()> {
    for q in THRESHOLDS {
        let threshold = Threshold::new(q)?;
        assert_eq!(threshold.photons(), q);
        for s in RATES {
            let below = poisson_below(q, s);
            let what = format!("q = {q}, s = {s}");
            assert_close(threshold.non_detection_probability(s), below, 1e-11, &what);
            assert!(
                (threshold.detection_probability(s) - (1.0 - below)).abs() < 1e-12,
                "{what}: {}",
                threshold.detection_probability(s)
            );
        }
        assert_eq!(
            [
                threshold.detection_probability(0.0),
                threshold.non_detection_probability(0.0)
            ]
            .map(f64::to_bits),
            [0.0f64, 1.0].map(f64::to_bits)
        );
    }
    Ok(())
}

#[test]
fn tails_keep_their_relative_accuracy() -> Result<()> {
    for (q, factorial) in [(1, 1.0), (2, 2.0), (3, 6.0), (5, 120.0)] {
        let threshold = Threshold::new(q)?;
        let s = 1e-9f64;
        assert_close(
            threshold.detection_probability(s),
            s.powi(q as i32) / factorial,
            1e-8,
            "faint",
        );
        let (s, k) = (700.0f64, q as i32 - 1);
        let leading = (-s).exp() * s.powi(k) * f64::from(q) / factorial;
        assert_close(
            threshold.non_detection_probability(s),
            leading,
            1.2 * f64::from(k) / s,
            "bright",
        );
    }
    Ok(())
}

#[test]
fn derivative_and_scores_agree_with_finite_differences() -> Result<()> {
    for q in THRESHOLDS {
        let threshold = Threshold::new(q)?;
        for s in RATES {
            let step = 1e-5 * s;
            let derivative = |f: &dyn Fn(f64) -> f64| (f(s + step) - f(s - step)) / (2.0 * step);
            let what = format!("q = {q}, s = {s}");
            let probability = threshold.detection_probability(s);
            if probability > 1e-290 {
                let lower = derivative(&|s| threshold.detection_probability(s).ln());
                assert!(
                    (threshold.detection_score(s) - lower).abs() < 1e-5 * (lower + 1e-5 / s),
                    "{what}: {} instead of {lower}",
                    threshold.detection_score(s)
                );
                assert_close(
                    threshold.detection_derivative(s),
                    threshold.detection_score(s) * probability,
                    1e-9,
                    &what,
                );
            }
            let upper = -derivative(&|s| threshold.non_detection_probability(s).ln());
            assert!(
                (threshold.non_detection_score(s) - upper).abs() < 1e-5 * (upper + 1e-5 / s),
                "{what}: {} instead of {upper}",
                threshold.non_detection_score(s)
            );
        }
    }
    Ok(())
}

#[test]
fn scores_stay_finite_where_probabilities_underflow() -> Result<()> {
    let threshold = Threshold::new(100)?;
    assert_eq!(threshold.detection_probability(1e-9).to_bits(), 0);
    assert_close(threshold.detection_score(1e-9), 100.0 / 1e-9, 1e-9, "faint");
    assert_eq!(threshold.non_detection_probability(1e4).to_bits(), 0);
    assert_close(
        threshold.non_detection_score(1e4),
        1.0 - 99.0 / 1e4,
        1e-4,
        "bright",
    );
    Ok(())
}

#[test]
fn inverse_restores_both_probabilities() -> Result<()> {
    for q in THRESHOLDS {
        let threshold = Threshold::new(q)?;
        for exponent in -280..0 {
            let probability = 10f64.powi(exponent);
            let what = format!("q = {q}, p = {probability}");
            assert_close(
                threshold
                    .detection_probability(threshold.inverse_detection_probability(probability)),
                probability,
                1e-11,
                &what,
            );
        }
        for exponent in 1..15 {
            let probability = 1.0 - 10f64.powi(-exponent);
            let what = format!("q = {q}, p = {probability}");
            let complement = threshold
                .non_detection_probability(threshold.inverse_detection_probability(probability));
            assert_close(complement, 1.0 - probability, 1e-11, &what);
        }
        assert_eq!(threshold.inverse_detection_probability(0.0).to_bits(), 0);
        assert!(threshold.inverse_detection_probability(1.0).is_infinite());
    }
    Ok(())
}

#[test]
fn infinite_light_is_always_detected() -> Result<()> {
    for q in THRESHOLDS {
        let threshold = Threshold::new(q)?;
        let ends = [
            threshold.detection_probability(f64::INFINITY),
            threshold.non_detection_probability(f64::INFINITY),
        ];
        assert_eq!(ends.map(f64::to_bits), [1.0f64, 0.0].map(f64::to_bits));
    }
    Ok(())
}

#[test]
fn probabilities_at_high_thresholds_are_those_of_mpmath() -> Result<()> {
    for (q, s, detection, non_detection) in [
        (
            1000,
            872.0,
            0.000_012_004_111_086_692_406,
            0.999_987_995_888_913_3,
        ),
        (
            1000,
            1000.0,
            0.504_205_244_180_215_5,
            0.495_794_755_819_784_5,
        ),
        (
            1000,
            1128.0,
            0.999_951_363_385_932_2,
            0.000_048_636_614_067_846_21,
        ),
        (
            65_535,
            64_511.0,
            0.000_029_129_654_608_435_82,
            0.999_970_870_345_391_6,
        ),
        (
            65_535,
            65_279.0,
            0.158_652_785_921_546_6,
            0.841_347_214_078_453_4,
        ),
        (
            65_535,
            65_535.0,
            0.500_519_460_101_487_9,
            0.499_480_539_898_512_1,
        ),
        (
            65_535,
            66_559.0,
            0.999_965_641_515_386_3,
            0.000_034_358_484_613_666_21,
        ),
    ] {
        let threshold = Threshold::new(q)?;
        let what = format!("q = {q}, s = {s}");
        assert_close(threshold.detection_probability(s), detection, 1e-9, &what);
        assert_close(
            threshold.non_detection_probability(s),
            non_detection,
            1e-9,
            &what,
        );
        let rate = threshold.inverse_detection_probability(detection);
        assert_close(rate, s, 1e-9, &what);
    }
    Ok(())
}

#[test]
fn a_threshold_of_zero_photons_is_an_error() {
    assert_eq!(
        Threshold::new(0),
        Err(Error::Range {
            what: "threshold",
            expected: "1 to 65535 photons".into(),
            received: "0".into()
        })
    );
}

#[test]
fn at_an_infinite_rate_a_zero_is_impossible() -> Result<()> {
    for q in THRESHOLDS {
        let threshold = Threshold::new(q)?;
        let zero = threshold.log_non_detection_probability(f64::INFINITY);
        assert!(zero.is_infinite() && zero < 0.0);
        let one = threshold.log_detection_probability(f64::INFINITY);
        assert!(one.abs() < f64::MIN_POSITIVE);
    }
    Ok(())
}
