//! The last values of a signal as one contiguous slice, oldest first.

/// A sliding window over a signal of `width` numbers per value.
///
/// Slices are ordered by time, oldest value first. Every value is written twice, half the buffer apart, so that no
/// slice wraps around.
#[derive(Debug, Clone)]
pub struct SlidingBuffer {
    width: usize,
    capacity: usize,
    buffer: Vec<f64>,
    next: usize,
    len: usize,
}

impl SlidingBuffer {
    /// An empty buffer with room for `capacity` values of `width` numbers each.
    pub fn new(capacity: usize, width: usize) -> Self {
        Self { width, capacity, buffer: vec![0.0; 2 * capacity * width], next: 0, len: 0 }
    }

    /// Number of values in the buffer.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether the buffer holds no value.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Removes all values.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Adds the newest value, whose numbers `fill` writes. A full buffer drops its oldest value.
    pub fn push_with(&mut self, fill: impl FnOnce(&mut [f64])) {
        let (low, high) = self.buffer.split_at_mut(self.capacity * self.width);
        let at = self.next * self.width..(self.next + 1) * self.width;
        fill(&mut low[at.clone()]);
        high[at.clone()].copy_from_slice(&low[at]);
        self.next = (self.next + 1) % self.capacity;
        self.len = (self.len + 1).min(self.capacity);
    }

    /// Adds the newest value of a signal of one number.
    pub fn push(&mut self, value: f64) {
        self.push_with(|slot| slot[0] = value);
    }

    /// The newest `count` values, oldest first. `count` is at most [`Self::len`].
    pub fn latest(&self, count: usize) -> &[f64] {
        debug_assert!(count <= self.len, "{count} of {} values", self.len);
        let end = (self.next + self.capacity) * self.width;
        &self.buffer[end - count * self.width..end]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_are_in_the_order_of_time_wherever_the_buffer_wraps() {
        let mut buffer = SlidingBuffer::new(5, 2);
        for i in 0..23 {
            buffer.push_with(|slot| slot.copy_from_slice(&[i as f64, -(i as f64)]));
            for count in 0..=buffer.len() {
                let expected: Vec<f64> = (i + 1 - count..=i).flat_map(|v| [v as f64, -(v as f64)]).collect();
                assert_eq!(buffer.latest(count), expected, "after {i}");
            }
        }
        assert_eq!(buffer.len(), 5);
    }
}
