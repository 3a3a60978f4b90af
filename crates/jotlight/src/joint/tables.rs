//! Tables of the responses of terms.

use std::sync::Arc;

use super::{Term, TermCells};
use crate::likelihood::Readings;
use crate::multibit::{Cells, Response};

/// The readings of the cells of a term, with a table of their response.
pub(super) enum Tabulated<'a, T> {
    Bits(Readings<'a>),
    Several(Cells<'a>, Arc<T>),
}

/// Return the cells of each term, with a table of their response.
///
/// Terms with the same response share a table, because a table may need 50 MB or more.
pub(super) fn with_tables<'a, T>(
    terms: &[Term<'a>],
    table: impl Fn(&'a Response) -> T,
) -> Vec<Tabulated<'a, T>> {
    let mut known: Vec<(&Response, Arc<T>)> = Vec::new();
    let with_table = |term: &Term<'a>| match term.cells {
        TermCells::Bits(readings) => Tabulated::Bits(readings),
        TermCells::Several(cells) => {
            let response = cells.response();
            let same = known.iter().find(|(each, _)| *each == response);
            let shared = same.map(|(_, shared)| Arc::clone(shared));
            let shared = shared.unwrap_or_else(|| {
                let new = Arc::new(table(response));
                known.push((response, Arc::clone(&new)));
                new
            });
            Tabulated::Several(cells, shared)
        }
    };
    terms.iter().map(with_table).collect()
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;
    use crate::error::Result;
    use crate::multibit::Sample;
    use crate::values::Values;

    #[test]
    fn terms_with_the_same_response_share_a_table() -> Result<()> {
        let responses = [
            Response::new(15, 0.3, 1)?,
            Response::new(15, 0.3, 1)?,
            Response::new(7, 0.3, 1)?,
            Response::new(15, 0.4, 1)?,
            Response::new(15, 0.0, 1)?,
            Response::new(15, 0.3, 2)?,
        ];
        let (one, none) = (Values::Same(1.0), Values::Same(0.0));
        let terms = responses.iter().map(|response| {
            let cells = Cells::new(response, Sample::Readings(&[3]), 1, one, none)?;
            Ok(Term {
                cells: TermCells::Several(cells),
                light: 1.0,
                side: 1,
                places: None,
            })
        });
        let terms = terms.collect::<Result<Vec<_>>>()?;
        let tables = Cell::new(0);
        with_tables(&terms, |_| tables.set(tables.get() + 1));
        assert_eq!(tables.get(), 5);
        Ok(())
    }
}
