//! Memory of a grid that is written, number by number.

/// Memory of a grid that is being laid out.
pub(super) struct Memory(pub Vec<u8>);

impl Memory {
    pub(crate) fn put<const N: usize>(&mut self, at: usize, bytes: [u8; N]) {
        self.0[at..at + N].copy_from_slice(&bytes);
    }
    pub(crate) fn u32(&mut self, at: usize, value: u32) {
        self.put(at, value.to_le_bytes());
    }
    pub(crate) fn u64(&mut self, at: usize, value: u64) {
        self.put(at, value.to_le_bytes());
    }
    pub(crate) fn f64s(&mut self, at: usize, values: &[f64]) {
        values.iter().enumerate().for_each(|(i, v)| self.put(at + 8 * i, v.to_le_bytes()));
    }
    pub(crate) fn coordinates(&mut self, at: usize, values: [i32; 3]) {
        values.iter().enumerate().for_each(|(i, v)| self.put(at + 4 * i, v.to_le_bytes()));
    }
    pub(crate) fn bounds(&mut self, at: usize, bounds: Option<([i32; 3], [i32; 3])>, empty: [i32; 3]) {
        let (low, high) = bounds.unwrap_or((empty, empty));
        self.coordinates(at, low);
        self.coordinates(at + 12, high);
    }
}
