//! Values that are kept for further calls.

use std::sync::{Arc, Mutex, MutexGuard};

/// The number of values that are kept.
const LENGTH: usize = 8;

/// Values with their keys.
type List<T> = Vec<(u32, Arc<T>)>;

/// The values of the last keys.
pub(crate) struct Kept<T> {
    values: Mutex<List<T>>,
}

impl<T> Kept<T> {
    pub const fn new() -> Self {
        Self {
            values: Mutex::new(Vec::new()),
        }
    }

    /// Return the list of values, unless another thread uses it now.
    ///
    /// Nobody may wait for the list: if the process forks while a thread uses it, the child never
    /// gets it. The child then computes its values itself.
    fn list(&self) -> Option<MutexGuard<'_, List<T>>> {
        self.values.try_lock().ok()
    }

    /// Return the value of a key. If it is not kept, `compute` returns it, while other threads use
    /// the list.
    pub fn get(&self, key: u32, compute: impl FnOnce() -> T) -> Arc<T> {
        let find = |values: &List<T>| {
            let found = values.iter().find(|(of, _)| *of == key);
            found.map(|(_, value)| Arc::clone(value))
        };
        if let Some(value) = self.list().and_then(|values| find(&values)) {
            return value;
        }
        let value = Arc::new(compute());
        if let Some(mut values) = self.list() {
            // Another thread may have computed the same value in the meantime.
            if let Some(known) = find(&values) {
                return known;
            }
            if values.len() == LENGTH {
                values.remove(0);
            }
            values.push((key, Arc::clone(&value)));
        }
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_values_are_kept() {
        let kept = Kept::new();
        let length = LENGTH as u32;
        for key in 0..=length {
            assert_eq!(*kept.get(key, || 10 * key), 10 * key);
        }
        for key in (1..=length).rev() {
            assert_eq!(*kept.get(key, || 0), 10 * key);
        }
        assert_eq!(*kept.get(0, || 7), 7);
    }

    #[test]
    fn others_use_the_list_while_a_value_is_computed() {
        let kept = Kept::new();
        let compute = || {
            assert!(kept.list().is_some());
            // Another thread is faster.
            *kept.get(2, || 30) + *kept.get(1, || 20)
        };
        assert_eq!(*kept.get(1, compute), 20);
        assert_eq!(*kept.get(2, || 0), 30);
        assert_eq!(kept.list().map(|values| values.len()), Some(2));
    }

    #[test]
    fn nobody_waits_for_the_list() {
        let kept = Kept::new();
        kept.get(1, || 10);
        let used = kept.list();
        assert_eq!(*kept.get(1, || 20), 20);
        drop(used);
        assert_eq!(*kept.get(1, || 30), 10);
    }
}
