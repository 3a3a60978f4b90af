use super::*;
use crate::likelihood::Threshold;
use crate::multibit::Sample;
use crate::values::Values;

#[test]
fn two_bits_have_the_maximum_in_closed_form() -> Result<()> {
    // A one at light x/2 and a zero at light 3x/2 have the maximum 2 log(4/3).
    let [ones, zeros] = [[1], [0]];
    let readings = |ones| {
        let (one, none) = (Values::Same(1.0), Values::Same(0.0));
        Readings::new(Threshold::new(1)?, ones, one, one, none)
    };
    let term = |ones, light| -> Result<Term<'_>> {
        Ok(Term {
            cells: TermCells::Bits(readings(ones)?),
            light,
            side: 1,
            places: None,
        })
    };
    let terms = vec![term(&ones, 0.5)?, term(&zeros, 1.5)?];
    let joint = JointReadings::new(terms, 1, 1)?;
    let mut intensity = [1.0];
    joint.maximize(9.0, 0.0, &mut intensity)?;
    assert!((intensity[0] - 2.0 * (4.0f64 / 3.0).ln()).abs() < 1e-12);
    joint.solve_total(&[1.0], 9.0, 0.0, &mut intensity)?;
    let x = intensity[0];
    assert!(((-x / 2.0).exp() + (-1.5 * x).exp() - 1.0).abs() < 1e-12);
    Ok(())
}

#[test]
fn a_total_of_0_is_expected_in_darkness() -> Result<()> {
    // About these lights, the mean reading underflows, but not its derivative.
    let sample = Sample::Histograms(&[1, 0]);
    for threshold in 100..400 {
        let response = Response::new(1, 1.0, threshold)?;
        let (one, dark) = (Values::Same(1.0), Values::Same(1e-100));
        let term = Term {
            cells: TermCells::Several(Cells::new(&response, sample, 1, one, dark)?),
            light: 1.0,
            side: 1,
            places: None,
        };
        let joint = JointReadings::new(vec![term], 1, 1)?;
        for start in [1e-4, 1e-3, 1e-2, 0.1, 0.5, 1.0] {
            let mut intensity = [start];
            joint.solve_total(&[0.0], 9.0, 1e-100, &mut intensity)?;
            assert!(
                intensity[0].abs() < 1e-300,
                "{threshold} {start} {intensity:?}"
            );
        }
    }
    Ok(())
}
