//! Acceptance tests of LAST.

mod skin;
