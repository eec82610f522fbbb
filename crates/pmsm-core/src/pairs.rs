//! Pairs of name and value, in order, written to files as a map.

use serde::{Serialize, Serializer};

/// For `#[serde(serialize_with = "…")]`.
pub fn as_map<N: Serialize, T: Serialize, S: Serializer>(
    pairs: &[(N, T)],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.collect_map(pairs.iter().map(|(name, value)| (name, value)))
}
