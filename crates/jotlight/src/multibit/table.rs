//! Functions of the rate, interpolated between nodes that are computed when they are needed.
//!
//! The exact functions are sums over all readings near the rate: hundreds of them for readings of
//! many bits. Images have far more pixels than a table has nodes.

use std::fmt;
use std::sync::OnceLock;

/// The smallest rate that is interpolated. The function itself is used below it.
const LOWEST: f64 = 1e-12;

/// The distance of the nodes in x = log s + 2 √s. For large s it is that of √s times 2, and the
/// standard deviation of √s is 1/2; for small s, the functions are powers of s, and smooth in log s.
const SPACING: f64 = 1.0 / 32.0;

/// The number of nodes of a polynomial.
pub(super) const NODES: usize = 6;

/// The nodes around a rate.
pub(super) struct Place {
    /// The number of the first node.
    pub first: usize,
    /// The weights of the nodes.
    pub weights: [f64; NODES],
}

impl Place {
    /// Return the place of a rate, or none if it is not a number or too small.
    pub fn of(s: f64) -> Option<Self> {
        (s >= LOWEST).then(|| {
            let place = position(s);
            let first = place as usize;
            Self {
                first,
                weights: lagrange(place - first as f64),
            }
        })
    }

    /// Return the nodes of the place among those from number `start` on, if all of them are there.
    pub fn of_nodes<'n, T>(&self, nodes: &'n [T], start: usize) -> Option<&'n [T]> {
        let first = self.first.checked_sub(start)?;
        nodes.get(first..)?.get(..NODES)
    }
}

/// `N` functions of the rate.
pub struct RateTable<F, const N: usize> {
    functions: F,
    nodes: Box<[OnceLock<[f64; N]>]>,
}

impl<F, const N: usize> fmt::Debug for RateTable<F, N> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table = formatter.debug_struct("RateTable");
        table.field("nodes", &self.nodes).finish_non_exhaustive()
    }
}

impl<F: Fn(f64) -> [f64; N] + Sync, const N: usize> RateTable<F, N> {
    /// Return a table of functions up to a rate. Beyond it, the functions themselves are used.
    pub(super) fn new(functions: F, highest: f64) -> Self {
        let length = node_at(highest) + NODES;
        let nodes = (0..length).map(|_| OnceLock::new()).collect();
        Self { functions, nodes }
    }

    /// Return the values of the functions at a rate.
    pub fn at(&self, s: f64) -> [f64; N] {
        let place = Place::of(s);
        let near = place.and_then(|place| Some((place.of_nodes(&self.nodes, 0)?, place)));
        let Some((nodes, place)) = near else {
            return (self.functions)(s);
        };
        let mut values = [0.0; N];
        for ((weight, node), number) in place.weights.iter().zip(nodes).zip(place.first..) {
            let known = node.get_or_init(|| (self.functions)(rate_at(number)));
            for (value, known) in values.iter_mut().zip(known) {
                *value += weight * known;
            }
        }
        if values.iter().all(|value| value.is_finite()) {
            values
        } else {
            (self.functions)(s)
        }
    }
}

/// Return the place of a rate among the nodes. The two nodes around it are the middle ones of six.
fn position(s: f64) -> f64 {
    (coordinate(s) - coordinate(LOWEST)) / SPACING
}

/// Return the number of the first node at or above a rate.
pub(super) fn node_at(s: f64) -> usize {
    position(s.max(LOWEST)).ceil() as usize
}

fn coordinate(s: f64) -> f64 {
    s.ln() + 2.0 * s.sqrt()
}

/// Return the rate of a node: the inverse of [`position`], by Newton's method about log s.
pub(super) fn rate_at(node: usize) -> f64 {
    let middle = (NODES / 2 - 1) as f64;
    let wanted = coordinate(LOWEST) + (node as f64 - middle) * SPACING;
    let mut log = if wanted < 2.0 {
        wanted - 2.0
    } else {
        2.0 * (wanted / 2.0).ln()
    };
    for _ in 0..20 {
        let root = (0.5 * log).exp();
        log -= (log + 2.0 * root - wanted) / (1.0 + root);
    }
    log.exp()
}

/// Return the weights of six nodes at −2, −1, 0, 1, 2, 3 for a place from 0 to 1.
fn lagrange(place: f64) -> [f64; NODES] {
    let distance: [f64; NODES] = std::array::from_fn(|node| place + 2.0 - node as f64);
    let divisors = [-120.0, 24.0, -12.0, 12.0, -24.0, 120.0];
    std::array::from_fn(|node| {
        let others = (0..NODES).filter(|&other| other != node);
        others.map(|other| distance[other]).product::<f64>() / divisors[node]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_at_their_positions() {
        for node in [0, 2, 100, 900, 2000, 10_000] {
            let place = position(rate_at(node));
            assert!(
                (place - (node as f64 - 2.0)).abs() < 1e-7,
                "{node}: {place}"
            );
        }
    }

    #[test]
    fn powers_and_waves_are_interpolated() {
        let functions = |s: f64| [s, 1.0 / s, (2.0 * s.sqrt()).sin()];
        let table = RateTable::new(functions, 1e4);
        for s in [
            1e-300, 1e-12, 2e-12, 1e-6, 0.01, 0.3, 1.0, 7.0, 300.0, 9e3, 1e6, 1e40,
        ] {
            for (found, exact) in table.at(s).into_iter().zip(functions(s)) {
                assert!(
                    (found - exact).abs() < 1e-9 * exact.abs().max(1e-3),
                    "{s}: {found}"
                );
            }
        }
    }
}
