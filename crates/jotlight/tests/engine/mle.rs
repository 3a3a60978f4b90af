//! Comparisons of maximum-likelihood estimates with equation (5) and with the score equation.

use jotlight::error::Result;
use jotlight::likelihood::Threshold;
use jotlight::mle::{self, JotCounts, JotResponse, JotResponses, PixelResponse};
use jotlight::values::Values;

const IDEAL: JotResponse = JotResponse {
    efficiency: 1.0,
    dark_counts: 0.0,
};

fn response(q: u32) -> Result<PixelResponse> {
    Ok(PixelResponse {
        threshold: Threshold::new(q)?,
        light_per_intensity: 1.3,
        max_intensity: 2.0,
    })
}

fn same(jot: JotResponse) -> JotResponses<'static> {
    JotResponses {
        efficiency: Values::Same(jot.efficiency),
        dark_counts: Values::Same(jot.dark_counts),
    }
}

#[test]
fn estimates_from_counts_agree_with_equation_5() -> Result<()> {
    let counts: Vec<i32> = (0..=16).chain(0..=16).collect();
    let mut out = vec![0.0; counts.len()];
    let jots = same(IDEAL);
    mle::from_counts(&response(1)?, &counts, Values::Same(16.0), &jots, &mut out)?;
    for (&count, estimate) in counts.iter().zip(out) {
        let expected = -(1.0 - f64::from(count) / 16.0).ln() / 1.3;
        assert!(
            (f64::from(estimate) - expected.min(2.0)).abs() < 1e-6,
            "{count}"
        );
    }
    Ok(())
}

#[test]
fn the_table_of_estimates_agrees_with_single_estimates() -> Result<()> {
    let counts: Vec<i32> = (0..100).map(|i| i % 10).collect();
    let (trials, jots) = (vec![9.0; 100], same(IDEAL));
    let response = response(2)?;
    let (mut table, mut single) = (vec![0.0; 100], vec![0.0; 100]);
    mle::from_counts(&response, &counts, Values::Same(9.0), &jots, &mut table)?;
    mle::from_counts(
        &response,
        &counts,
        Values::Each(&trials),
        &jots,
        &mut single,
    )?;
    assert_eq!(
        table.iter().map(|x| x.to_bits()).collect::<Vec<_>>(),
        single.iter().map(|x| x.to_bits()).collect::<Vec<_>>()
    );
    Ok(())
}

#[test]
fn estimates_restore_the_intensity_of_a_probability() -> Result<()> {
    let jot = JotResponse {
        efficiency: 0.6,
        dark_counts: 0.05,
    };
    for q in [1, 2, 5] {
        let response = response(q)?;
        for intensity in [0.2, 0.9, 1.7] {
            let rate = 0.6 * 1.3 * intensity + 0.05;
            let probability = response.threshold.detection_probability(rate);
            assert!(
                (response.intensity(probability, jot) - intensity).abs() < 1e-9,
                "q = {q}"
            );
            let mut out = [0.0];
            mle::from_probability(&response, &[probability as f32], jot, &mut out)?;
            assert!((f64::from(out[0]) - intensity).abs() < 1e-4, "q = {q}");
        }
    }
    Ok(())
}

#[test]
fn estimates_from_equal_jots_agree_with_those_from_counts() -> Result<()> {
    // There are 2 × 3 pixels of 2 × 2 jots. All jots of the last pixel are dead.
    let ones: Vec<i32> = (0..24).map(|jot| jot % 6).collect();
    let dead: Vec<bool> = (0..24).map(|jot| jot / 6 >= 2 && jot % 6 >= 4).collect();
    let jot = JotResponse {
        efficiency: 0.8,
        dark_counts: 0.03,
    };
    for q in [1, 2] {
        let counts = JotCounts {
            ones: &ones,
            responses: same(jot),
            dead: Some(&dead),
            frames: 5,
            oversampling: 2,
        };
        let mut from_jots = [0.0; 6];
        mle::from_jots(&response(q)?, &counts, (2, 3), &mut from_jots)?;
        // Each pixel covers two rows of jots with equal counts.
        let sums = [2, 10, 18, 2, 10];
        let mut from_counts = [0.0; 5];
        let trials = Values::Same(20.0);
        mle::from_counts(&response(q)?, &sums, trials, &same(jot), &mut from_counts)?;
        for (jots, counts) in from_jots.iter().zip(from_counts) {
            assert!((jots - counts).abs() < 1e-6, "q = {q}: {jots} and {counts}");
        }
        assert!(from_jots[5].is_nan());
    }
    Ok(())
}

#[test]
fn estimates_from_unequal_jots_solve_the_score_equation() -> Result<()> {
    let (ones, efficiency) = ([3, 1, 4, 2], [0.9, 0.3, 0.7, 0.5]);
    let counts = JotCounts {
        ones: &ones,
        responses: JotResponses {
            efficiency: Values::Each(&efficiency),
            dark_counts: Values::Same(0.01),
        },
        dead: None,
        frames: 5,
        oversampling: 2,
    };
    for q in [1, 3] {
        let response = PixelResponse {
            max_intensity: 50.0,
            ..response(q)?
        };
        let mut out = [0.0];
        mle::from_jots(&response, &counts, (1, 1), &mut out)?;
        let (mut score, mut scale) = (0.0, 0.0);
        for (&ones, efficiency) in ones.iter().zip(efficiency) {
            let rate = efficiency * 1.3 * f64::from(out[0]) + 0.01;
            let score_of_ones =
                efficiency * f64::from(ones) * response.threshold.detection_score(rate);
            let zeros = f64::from(5 - ones);
            score +=
                score_of_ones - efficiency * zeros * response.threshold.non_detection_score(rate);
            scale += score_of_ones;
        }
        assert!(score.abs() < 1e-5 * scale, "q = {q}: {score}");
    }
    Ok(())
}

#[test]
fn equivalent_counts_of_blind_jots_are_those_of_their_estimates() -> Result<()> {
    let (response, counts) = (response(1)?, [0, 1, 2]);
    let blind = JotResponse {
        efficiency: 0.0,
        dark_counts: 0.0,
    };
    let (mut estimates, mut equivalent) = ([0.0; 3], [0.0; 3]);
    let trials = Values::Same(2.0);
    mle::from_counts(&response, &counts, trials, &same(blind), &mut estimates)?;
    mle::equivalent_counts(
        &response,
        &counts,
        trials,
        &same(blind),
        &[4.0],
        IDEAL,
        &mut equivalent,
    )?;
    assert_eq!(
        estimates.map(f32::to_bits),
        [0.0f32, 2.0, 2.0].map(f32::to_bits)
    );
    assert_eq!(
        equivalent.map(f32::to_bits),
        [0.0f32, 4.0, 4.0].map(f32::to_bits)
    );
    Ok(())
}

#[test]
fn equivalent_counts_of_reference_jots_are_the_counts() -> Result<()> {
    let jot = JotResponse {
        efficiency: 0.5,
        dark_counts: 0.02,
    };
    let mut out = [0.0; 3];
    let trials = Values::Each(&[16.0, 8.0, 0.0][..]);
    mle::equivalent_counts(
        &response(1)?,
        &[4, 6, 0],
        trials,
        &same(jot),
        &[16.0],
        jot,
        &mut out,
    )?;
    assert_eq!(out[..2], [4.0, 12.0]);
    assert!(out[2].is_nan());
    // Ideal jots detect twice as much light, and have no dark counts.
    let mut ideal = [0.0; 3];
    mle::equivalent_counts(
        &response(1)?,
        &[4, 6, 0],
        trials,
        &same(jot),
        &[16.0],
        IDEAL,
        &mut ideal,
    )?;
    let light = (-(1.0f64 - 0.25).ln() - 0.02) / 0.5;
    assert!((f64::from(ideal[0]) - 16.0 * (1.0 - (-light).exp())).abs() < 1e-5);
    Ok(())
}

#[test]
fn the_images_of_a_stack_have_their_own_reference_trials() -> Result<()> {
    let (mut out, jot) = ([0.0; 4], IDEAL);
    let (trials, references) = (Values::Same(8.0), [16.0, 4.0]);
    let counts = [4, 6, 4, 6];
    let equivalent = |references: &[f64], out: &mut [f32]| {
        mle::equivalent_counts(
            &response(1)?,
            &counts,
            trials,
            &same(jot),
            references,
            jot,
            out,
        )
    };
    equivalent(&references, &mut out)?;
    assert_eq!(out[..], [8.0, 12.0, 2.0, 3.0]);
    assert!(equivalent(&[1.0; 3], &mut out).is_err());
    assert!(equivalent(&[], &mut out).is_err());
    Ok(())
}

#[test]
fn maps_of_jots_belong_to_each_image_of_a_stack() -> Result<()> {
    let ones: Vec<i32> = (0..16).map(|jot| jot * 5 % 6).collect();
    let efficiency = [0.9, 0.3, 0.7, 0.5, 0.8, 0.4, 0.6, 1.0];
    let dead = [false, false, true, false, false, false, false, false];
    let counts = |ones| JotCounts {
        ones,
        responses: JotResponses {
            efficiency: Values::Each(&efficiency),
            dark_counts: Values::Same(0.01),
        },
        dead: Some(&dead),
        frames: 5,
        oversampling: 2,
    };
    let (mut all, mut single) = ([0.0; 4], [0.0; 4]);
    mle::from_jots(&response(1)?, &counts(&ones), (1, 2), &mut all)?;
    for (ones, out) in ones.chunks(8).zip(single.chunks_mut(2)) {
        mle::from_jots(&response(1)?, &counts(ones), (1, 2), out)?;
    }
    assert_eq!(all[..], single[..]);
    assert!(mle::from_jots(&response(1)?, &counts(&ones), (2, 2), &mut all).is_err());
    Ok(())
}

/// Return all combinations of the elements of two arrays.
fn pairs<A: Copy, B: Copy>(first: &[A], second: &[B]) -> Vec<(A, B)> {
    let pairs = first
        .iter()
        .flat_map(|&a| second.iter().map(move |&b| (a, b)));
    pairs.collect()
}

#[test]
fn estimates_from_jots_end_for_any_response() -> Result<()> {
    let lights = [1.0, 1e-300, 1e160, f64::MAX];
    let maxima = [5e-324, 1e-162, 1.0, f64::MAX];
    let jots = [
        (1.0, 0.0),
        (0.0, 0.0),
        (f64::MAX, 0.0),
        (1e-300, 1e-300),
        (1.0, f64::MAX),
    ];
    for ((efficiency, dark_counts), (light, max_intensity)) in
        pairs(&jots, &pairs(&lights, &maxima))
    {
        let counts = JotCounts {
            ones: &[2, 1, 0, 3],
            responses: JotResponses {
                efficiency: Values::Each(&[1.0, 1.0, 1.0, efficiency]),
                dark_counts: Values::Same(dark_counts),
            },
            dead: None,
            frames: 3,
            oversampling: 2,
        };
        let response = PixelResponse {
            light_per_intensity: light,
            max_intensity,
            ..response(3)?
        };
        let mut out = [-1.0];
        mle::from_jots(&response, &counts, (1, 1), &mut out)?;
        assert!((0.0..=max_intensity as f32).contains(&out[0]));
    }
    Ok(())
}
