use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A slot for one item between a producer and a consumer: a newer item replaces one that was not taken.
pub struct Mailbox<T> {
    slot: Mutex<Slot<T>>,
    changed: Condvar,
}

/// What was in a mailbox.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Taken<T> {
    /// An item.
    Item(T),
    /// Nothing yet.
    Nothing,
    /// Nothing, and nothing will come.
    Closed,
}

struct Slot<T> {
    item: Option<T>,
    closed: bool,
}

impl<T> Default for Mailbox<T> {
    fn default() -> Self {
        Self { slot: Mutex::new(Slot { item: None, closed: false }), changed: Condvar::new() }
    }
}

impl<T> Mailbox<T> {
    fn lock(&self) -> MutexGuard<'_, Slot<T>> {
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts an item in; returns the one that it replaced.
    pub fn replace(&self, item: T) -> Option<T> {
        let replaced = self.lock().item.replace(item);
        self.changed.notify_all();
        replaced
    }

    /// Puts an item in once the one before was taken; false if the consumer is gone.
    pub fn put_after(&self, item: T) -> bool {
        let occupied = |slot: &mut Slot<T>| slot.item.is_some() && !slot.closed;
        let mut slot = self.changed.wait_while(self.lock(), occupied).unwrap_or_else(PoisonError::into_inner);
        if slot.closed {
            return false;
        }
        slot.item = Some(item);
        self.changed.notify_all();
        true
    }

    /// Waits for an item, at most `limit`.
    pub fn take(&self, limit: Duration) -> Taken<T> {
        let empty = |slot: &mut Slot<T>| slot.item.is_none() && !slot.closed;
        let waited = self.changed.wait_timeout_while(self.lock(), limit, empty);
        let (mut slot, _) = waited.unwrap_or_else(PoisonError::into_inner);
        let item = slot.item.take();
        self.changed.notify_all();
        match item {
            Some(item) => Taken::Item(item),
            None if slot.closed => Taken::Closed,
            None => Taken::Nothing,
        }
    }

    /// Ends the traffic: what is in the slot can still be taken.
    pub fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    /// Whether it was closed.
    pub fn is_closed(&self) -> bool {
        self.lock().closed
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    const LONG: Duration = Duration::from_secs(60);

    #[test]
    fn the_newest_item_wins() {
        let mailbox = Mailbox::default();
        assert_eq!(mailbox.replace(1), None);
        assert_eq!(mailbox.replace(2), Some(1));
        assert_eq!(mailbox.take(LONG), Taken::Item(2));
        assert_eq!(mailbox.take(Duration::from_millis(1)), Taken::Nothing);
        mailbox.replace(3);
        mailbox.close();
        assert_eq!(mailbox.take(LONG), Taken::Item(3));
        assert_eq!(mailbox.take(LONG), Taken::Closed);
    }

    #[test]
    fn putting_after_loses_nothing() {
        let mailbox = Arc::new(Mailbox::default());
        let producer = std::thread::spawn({
            let mailbox = Arc::clone(&mailbox);
            move || {
                (0..1000).for_each(|k| assert!(mailbox.put_after(k)));
                mailbox.close();
                mailbox.put_after(1000)
            }
        });
        let next = || match mailbox.take(LONG) {
            Taken::Item(item) => Some(item),
            Taken::Nothing | Taken::Closed => None,
        };
        let taken: Vec<i32> = std::iter::from_fn(next).collect();
        assert_eq!(taken, (0..1000).collect::<Vec<_>>());
        assert!(!producer.join().unwrap());
    }
}
