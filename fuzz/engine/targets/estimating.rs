//! Maximum-likelihood estimates.

use jotlight::error::Result;
use jotlight::likelihood::Threshold;
use jotlight::mle::{
    JotCounts, JotResponse, JotResponses, PixelResponse, equivalent_counts, from_counts, from_jots,
    from_probability,
};

use crate::Check;
use crate::arrays::consistent;
use crate::input::Input;
use crate::likelihood::{OneOrEach, one_or_each, trials_and_ones};

pub const CHECKS: &[(&str, Check)] = &[
    ("PixelResponse_intensity", check_intensity),
    ("mle_from_counts", check_from_counts),
    ("mle_from_probability", check_from_probability),
    ("mle_equivalent_counts", check_equivalent_counts),
    ("mle_from_jots", check_from_jots),
];

struct Pixels {
    threshold: u32,
    light_per_intensity: f64,
    max_intensity: f64,
    ones: Vec<i32>,
    trials: OneOrEach<f64>,
    efficiency: OneOrEach<f64>,
    dark_counts: OneOrEach<f64>,
    jot: JotResponse,
    out: Vec<f32>,
}

impl Pixels {
    fn new(input: &mut Input<'_>, threshold: u32, length: usize) -> Self {
        let (trials, ones) = trials_and_ones(input, length);
        Self {
            threshold,
            light_per_intensity: input.float(),
            max_intensity: input.float(),
            ones,
            trials,
            efficiency: one_or_each(input, length),
            dark_counts: one_or_each(input, length),
            jot: JotResponse {
                efficiency: input.float(),
                dark_counts: input.float(),
            },
            out: vec![0.0; input.almost(length)],
        }
    }

    fn response(&self) -> Result<PixelResponse> {
        Ok(PixelResponse {
            threshold: Threshold::new(self.threshold)?,
            light_per_intensity: self.light_per_intensity,
            max_intensity: self.max_intensity,
        })
    }

    fn jots(&self) -> JotResponses<'_> {
        JotResponses {
            efficiency: self.efficiency.get(),
            dark_counts: self.dark_counts.get(),
        }
    }

    /// Check that estimates lie in [0, S]. Pixels without readings are NaN.
    fn check_range(&self, estimates: &[f32], may_be_nan: bool) {
        let max = self.max_intensity as f32;
        for estimate in estimates {
            let is_inside = (0.0..=max).contains(estimate);
            assert!(
                is_inside || may_be_nan && estimate.is_nan(),
                "{estimate} of [0, {max}]"
            );
        }
    }
}

fn check_intensity(input: &mut Input<'_>) -> Option<()> {
    let (threshold, _) = input.threshold_and_length(0);
    let pixels = Pixels::new(input, threshold, 0);
    let intensity = pixels.response().ok()?.intensity(input.float(), pixels.jot);
    assert!(intensity <= pixels.max_intensity || pixels.max_intensity.is_nan());
    assert!(intensity >= 0.0 || pixels.max_intensity < 0.0);
    Some(())
}

fn check_from_counts(input: &mut Input<'_>) -> Option<()> {
    let length = input.size() * input.size();
    let (threshold, length) = input.threshold_and_length(length);
    let pixels = Pixels::new(input, threshold, length);
    let estimates = consistent(|_| {
        let (mut out, trials) = (pixels.out.clone(), pixels.trials.get());
        from_counts(
            &pixels.response()?,
            &pixels.ones,
            trials,
            &pixels.jots(),
            &mut out,
        )?;
        Ok(out)
    })?;
    pixels.check_range(&estimates, true);
    Some(())
}

fn check_from_probability(input: &mut Input<'_>) -> Option<()> {
    let length = input.size() * input.size();
    let (threshold, length) = input.threshold_and_length(length);
    let pixels = Pixels::new(input, threshold, length);
    let probability: Vec<f32> = input
        .floats(length)
        .into_iter()
        .map(|x| x as f32 / 16.0)
        .collect();
    let estimates = consistent(|_| {
        let mut out = pixels.out.clone();
        from_probability(&pixels.response()?, &probability, pixels.jot, &mut out)?;
        Ok(out)
    })?;
    pixels.check_range(&estimates, false);
    Some(())
}

fn check_equivalent_counts(input: &mut Input<'_>) -> Option<()> {
    let length = input.size() * input.size();
    let (threshold, length) = input.threshold_and_length(length);
    let pixels = Pixels::new(input, threshold, length);
    let images = if input.rarely(8) { input.below(4) } else { 1 };
    let reference_trials = input.floats(images);
    consistent(|_| {
        let (mut out, trials) = (pixels.out.clone(), pixels.trials.get());
        let (response, jots) = (pixels.response()?, pixels.jots());
        let ones = &pixels.ones;
        equivalent_counts(
            &response,
            ones,
            trials,
            &jots,
            &reference_trials,
            pixels.jot,
            &mut out,
        )?;
        Ok(out)
    })
    .map(|_| ())
}

fn check_from_jots(input: &mut Input<'_>) -> Option<()> {
    let (height, width, side) = (input.size(), input.size(), input.size().min(4));
    let (threshold, height) = input.threshold_and_length(height);
    let (width, side) = if threshold > 20 {
        (1, 1)
    } else {
        (width, side)
    };
    let jots = height * width * side * side;
    let pixels = Pixels::new(input, threshold, jots);
    let dead_length = input.almost(jots);
    let dead: Option<Vec<bool>> = input
        .rarely(3)
        .then(|| (0..dead_length).map(|_| input.random() % 3 == 0).collect());
    let oversampling = if input.rarely(32) {
        input.number()
    } else {
        side
    };
    let size = if input.rarely(16) {
        (input.number(), input.number())
    } else {
        (height, width)
    };
    let frames = match pixels.trials {
        OneOrEach::One(trials) => trials as i32,
        OneOrEach::Each(_) => input.count(),
    };
    let estimates = consistent(|_| {
        let counts = JotCounts {
            ones: &pixels.ones,
            responses: pixels.jots(),
            dead: dead.as_deref(),
            frames,
            oversampling,
        };
        let mut out = vec![0.0; height * width];
        from_jots(&pixels.response()?, &counts, size, &mut out)?;
        Ok(out)
    })?;
    pixels.check_range(&estimates, true);
    Some(())
}
