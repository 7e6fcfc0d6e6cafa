use std::sync::Arc;

/// Buffers that are reused once nobody holds them, so that capturing allocates nothing after a few frames.
#[derive(Debug, Default)]
pub struct BufferPool(Vec<Arc<Vec<u8>>>);

/// Most buffers that are kept. While all of them are held, further copies are allocated.
const KEPT: usize = 16;

impl BufferPool {
    /// A shared copy of `bytes`.
    pub fn copy_of(&mut self, bytes: &[u8]) -> Arc<Vec<u8>> {
        for buffer in &mut self.0 {
            if let Some(free) = Arc::get_mut(buffer) {
                free.clear();
                free.extend_from_slice(bytes);
                return Arc::clone(buffer);
            }
        }
        let buffer = Arc::new(bytes.to_vec());
        if self.0.len() < KEPT {
            self.0.push(Arc::clone(&buffer));
        }
        buffer
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_buffer_comes_back_once_nobody_holds_it() {
        let mut pool = BufferPool::default();
        let first = pool.copy_of(b"first, which is long");
        let second = pool.copy_of(b"second");
        assert_eq!((first.as_slice(), second.as_slice()), (&b"first, which is long"[..], &b"second"[..]));
        let address = first.as_ptr();
        drop(first);
        let third = pool.copy_of(b"third");
        assert_eq!((third.as_slice(), third.as_ptr()), (&b"third"[..], address));
        assert_eq!(second.as_slice(), b"second");
        let many: Vec<_> = (0..40_u8).map(|k| pool.copy_of(&[k])).collect();
        assert!(many.iter().enumerate().all(|(k, b)| b.as_slice() == [k as u8]) && pool.0.len() == KEPT);
    }
}
