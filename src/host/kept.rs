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
    /// Returns the values for keys: held values, and new ones. No other value is held any more: `make` gets the keys of
    /// the values to make, and the other values, whose memory it may use.
    pub(super) fn get_or_make(
        &self,
        keys: &[K],
        make: impl FnOnce(&[K], Vec<V>) -> Result<Vec<V>>,
    ) -> Result<Vec<Arc<V>>>
    where
        K: Clone,
    {
        let mut held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let dropped = held.extract_if(.., |(key, _)| !keys.contains(key));
        let spare = dropped.filter_map(|(_, value)| Arc::into_inner(value)).collect();
        let missing: Vec<K> = keys.iter().filter(|key| held.iter().all(|(of, _)| of != *key)).cloned().collect();
        if !missing.is_empty() {
            let made = make(&missing, spare)?;
            held.extend(missing.into_iter().zip(made.into_iter().map(Arc::new)));
        }
        let of = |key: &K| held.iter().find(|(of, _)| of == key).map(|(_, value)| Arc::clone(value));
        Ok(keys.iter().filter_map(of).collect())
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
