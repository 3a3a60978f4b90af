//! The log-likelihood, its derivatives, and its proximal map.

use jotlight::admm::AdmmStep;
use jotlight::error::Result;
use jotlight::likelihood::{Readings, Threshold};
use jotlight::values::Values;

use crate::Check;
use crate::arrays::consistent;
use crate::input::Input;

pub const CHECKS: &[(&str, Check)] = &[
    ("Readings_value", check_value),
    (
        "Readings_gradient_and_curvature",
        check_gradient_and_curvature,
    ),
    ("Readings_information", check_information),
    ("Readings_proximal", check_proximal),
    ("Readings_admm_update", check_admm_update),
];

/// One value for all elements, or one value per element.
pub enum OneOrEach<T> {
    One(T),
    Each(Vec<T>),
}

impl<T: Copy> OneOrEach<T> {
    pub fn get(&self) -> Values<'_, T> {
        match self {
            Self::One(value) => Values::Same(*value),
            Self::Each(values) => Values::Each(values),
        }
    }
}

pub fn one_or_each(input: &mut Input<'_>, length: usize) -> OneOrEach<f64> {
    if input.rarely(2) {
        let length = input.almost(length);
        OneOrEach::Each(input.floats(length))
    } else {
        OneOrEach::One(input.float())
    }
}

/// Return numbers of trials, and counts that mostly do not exceed them.
pub fn trials_and_ones(input: &mut Input<'_>, length: usize) -> (OneOrEach<f64>, Vec<i32>) {
    let max = input.count();
    let ones = input.counts(length, max);
    if input.rarely(3) {
        let length = input.almost(length);
        let more = input.counts(length, 3);
        let trials = ones.iter().chain([&0; 32]).zip(more);
        let fraction = input.float();
        let trials = trials.map(|(ones, more)| f64::from(*ones) + f64::from(more) + fraction);
        return (OneOrEach::Each(trials.collect()), ones);
    }
    (OneOrEach::One(f64::from(max)), ones)
}

struct Elements {
    threshold: u32,
    ones: Vec<i32>,
    trials: OneOrEach<f64>,
    efficiency: OneOrEach<f64>,
    dark_counts: OneOrEach<f64>,
    light: Vec<f64>,
    others: [Vec<f64>; 2],
    penalty: f64,
    max_light: f64,
}

impl Elements {
    fn new(input: &mut Input<'_>) -> Self {
        let length = input.size() * input.size();
        let (threshold, length) = input.threshold_and_length(length);
        let (trials, ones) = trials_and_ones(input, length);
        Self {
            threshold,
            ones,
            trials,
            efficiency: one_or_each(input, length),
            dark_counts: one_or_each(input, length),
            light: input.floats(length),
            others: [(); 2].map(|()| {
                let length = input.almost(length);
                input.floats(length)
            }),
            penalty: input.float(),
            max_light: input.float(),
        }
    }

    fn readings(&self) -> Result<Readings<'_>> {
        let readings = Readings::new(
            Threshold::new(self.threshold)?,
            &self.ones,
            self.trials.get(),
            self.efficiency.get(),
            self.dark_counts.get(),
        )?;
        assert_eq!(readings.len(), self.ones.len());
        assert_eq!(readings.is_empty(), self.ones.is_empty());
        Ok(readings)
    }
}

fn check_value(input: &mut Input<'_>) -> Option<()> {
    let elements = Elements::new(input);
    consistent(|_| Ok(vec![elements.readings()?.value(&elements.light)?])).map(|_| ())
}

fn check_gradient_and_curvature(input: &mut Input<'_>) -> Option<()> {
    let elements = Elements::new(input);
    consistent(|_| {
        let [mut gradient, mut curvature] = elements.others.clone();
        let readings = elements.readings()?;
        readings.gradient_and_curvature(&elements.light, &mut gradient, &mut curvature)?;
        Ok((gradient, curvature))
    })
    .map(|_| ())
}

fn check_information(input: &mut Input<'_>) -> Option<()> {
    let elements = Elements::new(input);
    consistent(|_| {
        let [mut information, _] = elements.others.clone();
        elements
            .readings()?
            .information(&elements.light, &mut information)?;
        Ok(information)
    })
    .map(|_| ())
}

fn check_proximal(input: &mut Input<'_>) -> Option<()> {
    let elements = Elements::new(input);
    let Elements {
        penalty, max_light, ..
    } = elements;
    let minimizers = consistent(|_| {
        let [guess, mut point] = elements.others.clone();
        elements
            .readings()?
            .proximal(penalty, max_light, &guess, &mut point)?;
        Ok(point)
    })?;
    for x in minimizers {
        assert!((0.0..=max_light).contains(&x), "{x} of [0, {max_light}]");
    }
    Some(())
}

fn check_admm_update(input: &mut Input<'_>) -> Option<()> {
    let elements = Elements::new(input);
    let step = AdmmStep {
        penalty: elements.penalty,
        relaxation: input.float(),
    };
    let steps = vec![step; 1 + input.below(3)];
    consistent(|_| {
        let [mut x, mut dual] = elements.others.clone();
        let (light, max_light) = (&elements.light, elements.max_light);
        let readings = elements.readings()?;
        let residuals = readings.admm_update(&steps, max_light, light, &mut x, &mut dual)?;
        Ok((residuals, (x, dual)))
    })
    .map(|_| ())
}
