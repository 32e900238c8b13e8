//! Bindings to the installed Embree, with a thin safe wrapper.
