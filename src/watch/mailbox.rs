use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A slot for one item between a producer and a consumer. A newer item replaces one that has not been taken, unless the
/// older one must be kept.
pub struct Mailbox<T> {
    slot: Mutex<Slot<T>>,
    changed: Condvar,
}

/// The result of putting an item in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Put<T> {
    /// The slot was empty.
    Alone,
    /// It replaced this item, which is dropped.
    Instead(T),
    /// The mailbox is closed and the item was dropped.
    Closed,
}

/// The result of taking an item out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Taken<T> {
    /// An item.
    Item(T),
    /// Nothing yet.
    Nothing,
    /// Nothing, and nothing will follow.
    Closed,
}

struct Slot<T> {
    /// The item, and whether it must be kept until it is taken.
    item: Option<(T, bool)>,
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

    /// Puts an item in. An item with `keep` is never replaced: the call waits until the item before it has been taken,
    /// and later calls wait until this one has been.
    pub fn put(&self, item: T, keep: bool) -> Put<T> {
        let must_wait = |slot: &mut Slot<T>| {
            let occupied = slot.item.as_ref().is_some_and(|(_, kept)| keep || *kept);
            occupied && !slot.closed
        };
        let mut slot = self.changed.wait_while(self.lock(), must_wait).unwrap_or_else(PoisonError::into_inner);
        if slot.closed {
            return Put::Closed;
        }
        let before = slot.item.replace((item, keep));
        self.changed.notify_all();
        before.map_or(Put::Alone, |(before, _)| Put::Instead(before))
    }

    /// Waits for an item, at most `limit`.
    pub fn take(&self, limit: Duration) -> Taken<T> {
        let empty = |slot: &mut Slot<T>| slot.item.is_none() && !slot.closed;
        let waited = self.changed.wait_timeout_while(self.lock(), limit, empty);
        let (mut slot, _) = waited.unwrap_or_else(PoisonError::into_inner);
        let item = slot.item.take();
        self.changed.notify_all();
        match item {
            Some((item, _)) => Taken::Item(item),
            None if slot.closed => Taken::Closed,
            None => Taken::Nothing,
        }
    }

    /// Closes the mailbox. An item already in the slot can still be taken.
    pub fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    /// Whether it has been closed.
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
        assert_eq!(mailbox.put(1, false), Put::Alone);
        assert_eq!(mailbox.put(2, false), Put::Instead(1));
        assert_eq!(mailbox.take(LONG), Taken::Item(2));
        assert_eq!(mailbox.take(Duration::from_millis(1)), Taken::Nothing);
        mailbox.put(3, false);
        mailbox.close();
        assert_eq!(mailbox.put(4, false), Put::Closed);
        assert_eq!(mailbox.take(LONG), Taken::Item(3));
        assert_eq!(mailbox.take(LONG), Taken::Closed);
    }

    /// Puts these items in, each with its `keep`, and returns what a slow consumer takes.
    fn taken(items: Vec<(u32, bool)>) -> Vec<u32> {
        let mailbox = Arc::new(Mailbox::default());
        let producer = std::thread::spawn({
            let mailbox = Arc::clone(&mailbox);
            move || {
                for (item, keep) in items {
                    assert_ne!(mailbox.put(item, keep), Put::Closed);
                }
                mailbox.close();
            }
        });
        let mut taken = Vec::new();
        loop {
            // By now the producer is either waiting or done.
            std::thread::sleep(Duration::from_millis(5));
            match mailbox.take(LONG) {
                Taken::Item(item) => taken.push(item),
                Taken::Nothing | Taken::Closed => break,
            }
        }
        producer.join().unwrap();
        taken
    }

    #[test]
    fn what_must_be_kept_is_never_lost() {
        assert_eq!(taken((0..100).map(|k| (k, true)).collect()), (0..100).collect::<Vec<_>>());
        // An item that may be dropped waits behind one that may not.
        let kept: Vec<u32> = taken((0..60).map(|k| (k, k % 3 == 0)).collect());
        assert!((0..60).step_by(3).all(|k| kept.contains(&k)), "{kept:?}");
        assert!(kept.is_sorted(), "{kept:?}");
    }
}
