//! Arrays with hostile memory layouts, and the comparison of two runs of an entry point.

use jotlight::error::{Error, Result};
use jotlight::threads::install;
use ndarray::{
    ArrayD, ArrayView, ArrayViewD, ArrayViewMut, Axis, Dimension, IntoDimension, IxDyn, Slice,
};

use crate::input::Input;

/// How an axis of an array lies in memory.
#[derive(Clone, Copy)]
enum Order {
    Forward,
    Reversed,
    EverySecond,
}

/// An array with an arbitrary memory layout.
#[derive(Clone)]
pub struct Grid<T> {
    base: ArrayD<T>,
    orders: Vec<Order>,
    is_transposed: bool,
}

impl<T: Clone + Default> Grid<T> {
    /// Return an array with `values` in row-major order.
    pub fn new(input: &mut Input<'_>, shape: impl IntoDimension, values: Vec<T>) -> Self {
        let shape = shape.into_dimension();
        let orders: Vec<Order> = (0..shape.ndim())
            .map(|_| match input.below(6) {
                0 => Order::Reversed,
                1 => Order::EverySecond,
                _ => Order::Forward,
            })
            .collect();
        let is_transposed = input.rarely(4);
        let stored = shape.slice().iter().zip(&orders);
        let mut stored: Vec<usize> = stored
            .map(|(&size, order)| match order {
                Order::EverySecond => 2 * size,
                _ => size,
            })
            .collect();
        if is_transposed {
            stored.reverse();
        }
        let mut grid = Self {
            base: ArrayD::default(IxDyn(&stored)),
            orders,
            is_transposed,
        };
        let view: ArrayViewMut<'_, T, IxDyn> = grid.view_mut();
        for (place, value) in view.into_iter().zip(values) {
            *place = value;
        }
        grid
    }

    pub fn view<D: Dimension>(&self) -> ArrayView<'_, T, D> {
        let mut view = self.base.view();
        if self.is_transposed {
            view = view.reversed_axes();
        }
        for (axis, order) in self.orders.iter().enumerate() {
            match order {
                Order::Forward => (),
                Order::Reversed => view.invert_axis(Axis(axis)),
                Order::EverySecond => view.slice_axis_inplace(Axis(axis), Slice::new(0, None, 2)),
            }
        }
        view.into_dimensionality().expect("the number of axes")
    }

    pub fn view_mut<D: Dimension>(&mut self) -> ArrayViewMut<'_, T, D> {
        let mut view = self.base.view_mut();
        if self.is_transposed {
            view = view.reversed_axes();
        }
        for (axis, order) in self.orders.iter().enumerate() {
            match order {
                Order::Forward => (),
                Order::Reversed => view.invert_axis(Axis(axis)),
                Order::EverySecond => view.slice_axis_inplace(Axis(axis), Slice::new(0, None, 2)),
            }
        }
        view.into_dimensionality().expect("the number of axes")
    }

    /// Return the same array in row-major order.
    pub fn to_standard(&self) -> Self {
        let view: ArrayViewD<'_, T> = self.view();
        Self {
            orders: vec![Order::Forward; view.ndim()],
            base: view.as_standard_layout().into_owned(),
            is_transposed: false,
        }
    }

    /// Return this array, or the same array in row-major order.
    pub fn arranged(&self, is_standard: bool) -> Self {
        if is_standard {
            self.to_standard()
        } else {
            self.clone()
        }
    }

    /// Return the values in row-major order.
    pub fn values(&self) -> Vec<T> {
        let view: ArrayViewD<'_, T> = self.view();
        view.iter().cloned().collect()
    }
}

impl Grid<f64> {
    pub fn floats(input: &mut Input<'_>, shape: impl IntoDimension) -> Self {
        let shape = shape.into_dimension();
        let values = input.floats(shape.size());
        Self::new(input, shape, values)
    }

    pub fn to_f32(&self) -> Grid<f32> {
        Grid {
            base: self.base.mapv(|x| x as f32),
            orders: self.orders.clone(),
            is_transposed: self.is_transposed,
        }
    }
}

/// Values that two runs must agree on, bit by bit.
pub trait Comparable {
    fn bits(&self) -> Vec<u64>;
}

impl Comparable for Vec<f64> {
    fn bits(&self) -> Vec<u64> {
        // NaNs differ in their bits for no reason.
        let bits = |x: &f64| if x.is_nan() { u64::MAX } else { x.to_bits() };
        self.iter().map(bits).collect()
    }
}

impl Comparable for Vec<f32> {
    fn bits(&self) -> Vec<u64> {
        self.iter()
            .map(|&x| f64::from(x))
            .collect::<Vec<_>>()
            .bits()
    }
}

impl Comparable for Vec<i32> {
    fn bits(&self) -> Vec<u64> {
        self.iter().map(|&x| u64::from(x.cast_unsigned())).collect()
    }
}

impl Comparable for Vec<u8> {
    fn bits(&self) -> Vec<u64> {
        self.iter().map(|&x| u64::from(x)).collect()
    }
}

impl<A: Comparable, B: Comparable> Comparable for (A, B) {
    fn bits(&self) -> Vec<u64> {
        [self.0.bits(), self.1.bits()].concat()
    }
}

/// Run `compute` with hostile layouts on one thread, and with arrays in row-major order on three
/// threads. Check that both return the same, and return it.
pub fn consistent<R: Comparable + Send>(compute: impl Fn(bool) -> Result<R> + Sync) -> Option<R> {
    let first = flattened(install(Some(1), || compute(false)));
    let second = flattened(install(Some(3), || compute(true)));
    match (first, second) {
        (Ok(first), Ok(second)) => {
            assert_eq!(first.bits(), second.bits(), "layouts or threads matter");
            Some(first)
        }
        (Err(first), Err(second)) => {
            assert!(!first.to_string().is_empty());
            assert_eq!(first, second, "layouts or threads matter for an error");
            None
        }
        (first, second) => panic!("{:?} but {:?}", first.err(), second.err()),
    }
}

fn flattened<R>(result: Result<Result<R>>) -> Result<R> {
    let result = result.and_then(|result| result);
    assert!(!matches!(result, Err(Error::Interrupted)));
    result
}
