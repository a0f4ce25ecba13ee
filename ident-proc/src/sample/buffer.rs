//! The recent past as contiguous slices.

/// The last values of a signal of `width` numbers each, always readable as one slice in the order of time.
///
/// Every value is written twice, half the buffer apart, so that no read ever wraps around.
#[derive(Debug, Clone)]
pub struct SlidingBuffer {
    width: usize,
    capacity: usize,
    buffer: Vec<f64>,
    next: usize,
    len: usize,
}

impl SlidingBuffer {
    /// Room for `capacity` values of `width` numbers.
    pub fn new(capacity: usize, width: usize) -> Self {
        Self { width, capacity, buffer: vec![0.0; 2 * capacity * width], next: 0, len: 0 }
    }

    /// Values held.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether no value is held.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Forgets all values.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Adds the newest value; `fill` writes its numbers.
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

    /// The newest `count` values, oldest first; at most as many as are held.
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
        let mut history = SlidingBuffer::new(5, 2);
        for i in 0..23 {
            history.push_with(|slot| slot.copy_from_slice(&[i as f64, -(i as f64)]));
            for count in 0..=history.len() {
                let expected: Vec<f64> = (i + 1 - count..=i).flat_map(|v| [v as f64, -(v as f64)]).collect();
                assert_eq!(history.latest(count), expected, "after {i}");
            }
        }
        assert_eq!(history.len(), 5);
    }
}
