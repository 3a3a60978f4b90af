//! The absence of AMX: another processor, or another system than Linux.

use super::{Line, TileShape, TileUnit};

/// Tiles that do not exist.
pub(super) enum Amx {}

impl Amx {
    /// Return false.
    pub fn is_available() -> bool {
        false
    }
}

impl TileUnit for Amx {
    fn configured(_: TileShape) -> Self {
        unreachable!("no tiles without AMX")
    }

    fn load_filters<const TILE: usize>(&mut self, _: &[Line]) {
        match *self {}
    }

    fn load_planes<const TILE: usize>(&mut self, _: &[u32], _: usize) {
        match *self {}
    }

    fn zero<const TILE: usize>(&mut self) {
        match *self {}
    }

    fn multiply<const SUMS: usize, const FILTERS: usize, const PLANES: usize>(&mut self) {
        match *self {}
    }

    fn store<const TILE: usize>(&self, _: &mut [f32], _: usize) {
        match *self {}
    }
}
