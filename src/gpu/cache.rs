//! Values that are made once and kept: pipelines on a renderer, packed splats and the like on a scene.

use std::any::{Any, TypeId};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::hash::Hash;
use std::sync::{Arc, Mutex, PoisonError};

use crate::error::Result;

/// Values of any type, by the types of key and value, then by key. The owner of a cache need not know the types.
#[derive(Default)]
pub(crate) struct Cache(Mutex<HashMap<TypeId, Arc<dyn Any + Send + Sync>>>);

/// The values of one type by their keys.
type Kept<K, V> = Mutex<HashMap<K, Arc<V>>>;

impl Cache {
    /// Returns the value for `key`, made now if there is none. Meanwhile other callers with the same types wait.
    pub(crate) fn get_or_make<K, V>(&self, key: K, make: impl FnOnce() -> Result<V>) -> Result<Arc<V>>
    where
        K: Eq + Hash + Send + 'static,
        V: Send + Sync + 'static,
    {
        let Ok(kept) = Arc::downcast::<Kept<K, V>>(self.of::<K, V>()) else { return Ok(Arc::new(make()?)) };
        let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(match kept.entry(key) {
            Entry::Occupied(value) => Arc::clone(value.get()),
            Entry::Vacant(place) => Arc::clone(place.insert(Arc::new(make()?))),
        })
    }

    /// Returns all values of the types `K` and `V`.
    fn of<K: Send + 'static, V: Send + Sync + 'static>(&self) -> Arc<dyn Any + Send + Sync> {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let place = kept.entry(TypeId::of::<(K, V)>()).or_insert_with(|| Arc::new(Kept::<K, V>::default()));
        Arc::clone(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_made_once_for_a_key_and_a_type() {
        let cache = Cache::default();
        let get = |key: u32, value: &str| cache.get_or_make(key, || Ok(value.to_owned())).unwrap();
        assert_eq!([get(1, "a"), get(1, "b"), get(2, "b")].map(|v| v.to_string()), ["a", "a", "b"]);
        assert_eq!(*cache.get_or_make(1_u32, || Ok(7_u8)).unwrap(), 7);
    }
}
