//! `mesh compare`: how far two surfaces are apart.
