//! Diagnosis: what does the model of this machine leave out?
pub mod hypothesis;
pub mod shortlist;
pub mod search;
pub mod verdict;
