//! Values that are kept from picture to picture.

use std::sync::{Arc, Mutex, PoisonError};

use crate::error::Result;

/// The values made for the last picture, with their keys.
pub(super) struct Kept<K, V>(Mutex<Vec<(K, Arc<V>)>>);

impl<K, V> Default for Kept<K, V> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<K: PartialEq, V> Kept<K, V> {
    /// Returns the values for keys: held values, or new ones of `make` after all other values are dropped.
    pub(super) fn get_or_make(&self, keys: Vec<K>, make: impl Fn(&K) -> Result<V>) -> Result<Vec<Arc<V>>> {
        let mut held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        held.retain(|(key, _)| keys.contains(key));
        let mut values = Vec::with_capacity(keys.len());
        for key in keys {
            let value = match held.iter().find(|(of, _)| *of == key) {
                Some((_, value)) => Arc::clone(value),
                None => {
                    let made = Arc::new(make(&key)?);
                    held.push((key, Arc::clone(&made)));
                    made
                }
            };
            values.push(value);
        }
        Ok(values)
    }

    /// Returns the sum of `number` over all values.
    pub(super) fn sum(&self, number: impl Fn(&V) -> u64) -> u64 {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).iter().map(|(_, value)| number(value)).sum()
    }

    /// Returns the number of values held.
    pub(super) fn count(&self) -> usize {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).len()
    }
}
