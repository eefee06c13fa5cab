//! Fields of objects: planes, heads, densities and compositing against closed forms.

mod directions;
mod occupancy;
mod planes;
mod quadrature;
mod surfaces;
mod volume;
