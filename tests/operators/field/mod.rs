//! Fields of objects: planes, heads, densities and compositing against closed forms.

mod directions;
mod figure;
mod made;
mod occupancy;
mod planes;
mod plans;
mod quadrature;
mod render;
mod surfaces;
mod volume;
