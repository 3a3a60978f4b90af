//! Functions without arrays, and calls with numbers of threads.

use jotlight::bits::packed_width;
use jotlight::cpu::Level;
use jotlight::error::Error;
use jotlight::likelihood::Threshold;
use jotlight::roofline;
use jotlight::sensing::Kernel;
use jotlight::threads::{install, install_interruptible};
use jotlight::vst::{Anscombe, ExactInverse, algebraic_inverse, map};

use crate::Check;
use crate::arrays::{Grid, consistent};
use crate::input::Input;

pub const CHECKS: &[(&str, Check)] = &[
    ("Threshold", check_threshold),
    ("Kernel", check_kernel),
    ("Anscombe", check_anscombe),
    ("ExactInverse", check_exact_inverse),
    ("vst_map", check_map),
    ("install", check_install),
    ("cpu_Level", check_level),
    ("roofline", check_roofline),
    ("packed_width", check_packed_width),
];

fn check_threshold(input: &mut Input<'_>) -> Option<()> {
    let q = input.number() as u32;
    let threshold = Threshold::new(q);
    assert_eq!(threshold.is_ok(), (1..=Threshold::MAX_PHOTONS).contains(&q));
    let (threshold, s, p) = (threshold.ok()?, input.float(), input.float());
    let values = [
        threshold.detection_derivative(s),
        threshold.detection_score(s),
        threshold.non_detection_score(s),
        threshold.log_detection_probability(s),
        threshold.log_non_detection_probability(s),
        threshold.detection_score_and_curvature(s).1,
        threshold.non_detection_score_and_curvature(s).1,
    ];
    let detection = threshold.detection_probability(s);
    let non_detection = threshold.non_detection_probability(s);
    if s >= 0.0 {
        assert!(
            (0.0..=1.0).contains(&detection),
            "q = {q}, s = {s}: {detection}"
        );
        assert!(
            (0.0..=1.0).contains(&non_detection),
            "q = {q}, s = {s}: {non_detection}"
        );
        assert!(
            (detection + non_detection - 1.0).abs() < 1e-12,
            "q = {q}, s = {s}"
        );
    }
    if (1e-100..1e100).contains(&s) {
        assert!(
            values.iter().all(|x| x.is_finite()),
            "q = {q}, s = {s}: {values:?}"
        );
    }
    let rate = threshold.inverse_detection_probability(p);
    assert!(rate >= 0.0 || p.is_nan(), "q = {q}, p = {p}: {rate}");
    Some(())
}

fn check_kernel(input: &mut Input<'_>) -> Option<()> {
    let (degree, oversampling) = (input.number(), input.number());
    let kernel = Kernel::new(degree, oversampling);
    let is_valid = degree <= 3 && (1..=Kernel::MAX_OVERSAMPLING).contains(&oversampling);
    assert_eq!(kernel.is_ok(), is_valid);
    let kernel = kernel.ok()?;
    assert_eq!(
        (kernel.degree(), kernel.oversampling()),
        (degree, oversampling)
    );
    let sum: f64 = kernel.taps().iter().sum();
    assert!((sum - 1.0).abs() < 1e-9 && kernel.taps().iter().all(|tap| *tap >= 0.0));
    Some(())
}

fn check_anscombe(input: &mut Input<'_>) -> Option<()> {
    let trials = input.number() as u32;
    let anscombe = Anscombe::new(trials);
    assert_eq!(anscombe.is_ok(), trials > 0);
    let (anscombe, x) = (anscombe.ok()?, input.float());
    let inverse = algebraic_inverse(x, f64::from(trials));
    assert!(inverse.is_nan() == x.is_nan());
    assert!(x.is_nan() || (0.0..=f64::from(trials)).contains(&inverse));
    let transformed = anscombe.transform(x);
    assert!(transformed.is_finite() || !(x >= -0.375));
    // The time of an expectation grows with the square root of K.
    if trials <= 1 << 20 {
        let expectation = anscombe.expectation(x);
        assert!(
            expectation.is_finite() || x.is_nan(),
            "K = {trials}, p = {x}: {expectation}"
        );
    }
    Some(())
}

fn check_exact_inverse(input: &mut Input<'_>) -> Option<()> {
    // The table takes seconds for the largest K.
    let trials = input.number() as u32 % 64;
    let inverse = install(Some(1), || ExactInverse::new(trials)).and_then(|result| result);
    assert_eq!(inverse.is_ok(), trials > 0);
    let inverse = inverse.ok()?;
    for z in input.floats(8) {
        assert!(
            (0.0..=f64::from(trials)).contains(&inverse.inverse(z)),
            "K = {trials}, z = {z}"
        );
    }
    Some(())
}

fn check_map(input: &mut Input<'_>) -> Option<()> {
    let length = input.size();
    let values = Grid::floats(input, length).to_f32();
    let out_length = input.almost(length);
    let out = Grid::new(input, out_length, vec![0.0f32; out_length]);
    consistent(|is_standard| {
        let (values, mut out) = (values.arranged(is_standard), out.arranged(is_standard));
        map(values.view(), out.view_mut(), |x| x * 2.0)?;
        Ok(out.values())
    })
    .map(|_| ())
}

fn check_install(input: &mut Input<'_>) -> Option<()> {
    // A pool of a thousand threads takes long to start.
    let threads = match input.number() {
        large @ 4..1025 => large % 4,
        other => other,
    };
    let is_interrupted: fn() -> bool = if input.rarely(2) { || true } else { || false };
    let fails = input.rarely(4);
    let work = || {
        if fails {
            return Err(Error::Interrupted);
        }
        Ok(())
    };
    let result = install_interruptible(Some(threads), is_interrupted, work);
    match result {
        Ok(()) => assert!((1..=1024).contains(&threads) && !fails),
        Err(Error::Interrupted) => assert!(fails || is_interrupted()),
        Err(error) => assert!(!(1..=1024).contains(&threads), "{error}"),
    }
    Some(())
}

fn check_level(input: &mut Input<'_>) -> Option<()> {
    let length = input.size();
    let bytes = input.random_bytes(length);
    let name = String::from_utf8_lossy(&bytes);
    let known = Level::supported()
        .into_iter()
        .any(|level| level.name() == name);
    assert_eq!(Level::choose(Some(&name)).is_ok(), known);
    assert!(Level::choose(None).is_ok());
    assert_eq!(Some(&Level::current()), Level::supported().last());
    Some(())
}

fn check_roofline(input: &mut Input<'_>) -> Option<()> {
    let (rounds, length) = (input.size() * 100, input.size() * 1000);
    assert!(roofline::multiply_adds(rounds).is_multiple_of(24));
    let words: Vec<u64> = (0..length).map(|_| input.random()).collect();
    let sum = words.iter().fold(0u64, |sum, &word| sum.wrapping_add(word));
    assert_eq!(roofline::read_words(&words), sum);
    Some(())
}

fn check_packed_width(input: &mut Input<'_>) -> Option<()> {
    let width = input.number();
    let bytes = packed_width(width);
    assert!(bytes >= width / 8 && bytes <= width / 8 + 1);
    Some(())
}
