//! From and to grids of OpenVDB.
