use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, PoisonError};

use crate::server::access::network;

/// Counts open connections, in total and per sender, so that neither one sender nor all together exhaust the sockets.
#[derive(Debug, Clone)]
pub(super) struct Slots {
    most: usize,
    most_of_one: usize,
    taken: Arc<Mutex<Taken>>,
}

#[derive(Debug, Default)]
struct Taken {
    all: usize,
    of: HashMap<IpAddr, usize>,
}

/// Counts one connection until it is dropped.
#[derive(Debug)]
pub(super) struct Slot {
    sender: IpAddr,
    taken: Arc<Mutex<Taken>>,
}

impl Slots {
    pub(super) fn new(most: usize, most_of_one: usize) -> Self {
        Self { most, most_of_one, taken: Arc::default() }
    }

    /// A slot for a connection from this address; `None` if none is left.
    pub(super) fn take(&self, address: IpAddr) -> Option<Slot> {
        let sender = network(address);
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        let of_it = taken.of.get(&sender).copied().unwrap_or(0);
        if taken.all >= self.most || of_it >= self.most_of_one {
            return None;
        }
        taken.all += 1;
        taken.of.insert(sender, of_it + 1);
        Some(Slot { sender, taken: Arc::clone(&self.taken) })
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        taken.all -= 1;
        match taken.of.get_mut(&self.sender) {
            Some(of_it) if *of_it > 1 => *of_it -= 1,
            _ => drop(taken.of.remove(&self.sender)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neither_one_sender_nor_all_of_them_take_more_than_they_may() {
        let slots = Slots::new(3, 2);
        let (one, other) = (IpAddr::from([192, 0, 2, 1]), IpAddr::from([192, 0, 2, 2]));
        let first = slots.take(one).expect("a free slot");
        let _second = slots.take(one).expect("a free slot");
        assert!(slots.take(one).is_none(), "one sender's share is taken");
        let third = slots.take(other).expect("a free slot for others");
        assert!(slots.take(other).is_none(), "all slots are taken");
        drop(first);
        assert!(slots.take(one).is_some());
        drop(third);
        assert_eq!(slots.taken.lock().unwrap().of.len(), 1, "a sender without connections is forgotten");
    }
}
