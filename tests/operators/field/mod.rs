//! Fields of objects: planes, heads, densities and compositing against closed forms.

mod planes;
mod volume;
