use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

use crate::server::access::network;

/// Counts open connections, in total and per sender, so that neither one sender nor all together exhaust the sockets.
/// Where no slot is left, a new connection gets that of the one that has been idle for longest: a thousand connections
/// that ask for nothing keep nobody from asking.
#[derive(Debug, Clone)]
pub(super) struct Slots {
    most: usize,
    most_of_one: usize,
    taken: Arc<Mutex<Taken>>,
}

#[derive(Debug, Default)]
struct Taken {
    open: HashMap<u64, Open>,
    of: HashMap<IpAddr, usize>,
    /// Numbers connections, and the moments at which they became idle.
    counter: u64,
}

/// An open connection.
#[derive(Debug)]
struct Open {
    sender: IpAddr,
    /// When it became idle; `None` while it is asked for something.
    idle: Option<u64>,
    /// Told when the connection has to go.
    gone: Arc<Notify>,
}

/// Counts one connection until it is dropped.
#[derive(Debug)]
pub(super) struct Slot {
    number: u64,
    gone: Arc<Notify>,
    taken: Arc<Mutex<Taken>>,
}

/// Says when a connection is idle.
#[derive(Debug, Clone)]
pub(super) struct Use {
    number: u64,
    taken: Arc<Mutex<Taken>>,
}

/// A connection is not idle until this is dropped.
#[derive(Debug)]
pub(super) struct Busy {
    of: Use,
    for_good: bool,
}

impl Slots {
    pub(super) fn new(most: usize, most_of_one: usize) -> Self {
        Self { most, most_of_one, taken: Arc::default() }
    }

    /// A slot for a connection from this address; `None` if none is left and none can be freed.
    pub(super) fn take(&self, address: IpAddr) -> Option<Slot> {
        let sender = network(address);
        let mut taken = lock(&self.taken);
        if taken.of.get(&sender).is_some_and(|&of_it| of_it >= self.most_of_one) {
            taken.free(|open| open.sender == sender)?;
        } else if taken.open.len() >= self.most {
            taken.free(|_| true)?;
        }
        let number = taken.next();
        let gone = Arc::new(Notify::new());
        taken.open.insert(number, Open { sender, idle: Some(number), gone: Arc::clone(&gone) });
        *taken.of.entry(sender).or_default() += 1;
        Some(Slot { number, gone, taken: Arc::clone(&self.taken) })
    }
}

impl Taken {
    fn next(&mut self) -> u64 {
        self.counter += 1;
        self.counter
    }

    /// Has the connection go that has been idle for longest; `None` if none is.
    fn free(&mut self, among: impl Fn(&Open) -> bool) -> Option<()> {
        let idle = self.open.iter().filter(|(_, open)| among(open));
        let (_, number) = idle.filter_map(|(&number, open)| Some((open.idle?, number))).min()?;
        self.remove(number).map(|open| open.gone.notify_one())
    }

    fn remove(&mut self, number: u64) -> Option<Open> {
        let open = self.open.remove(&number)?;
        match self.of.get_mut(&open.sender) {
            Some(of_it) if *of_it > 1 => *of_it -= 1,
            _ => drop(self.of.remove(&open.sender)),
        }
        Some(open)
    }
}

impl Slot {
    /// Told when the connection has to go, for another one.
    pub(super) fn gone(&self) -> Arc<Notify> {
        Arc::clone(&self.gone)
    }

    pub(super) fn uses(&self) -> Use {
        Use { number: self.number, taken: Arc::clone(&self.taken) }
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        lock(&self.taken).remove(self.number);
    }
}

impl Use {
    /// The connection is asked for something.
    pub(super) fn begin(&self) -> Busy {
        if let Some(open) = lock(&self.taken).open.get_mut(&self.number) {
            open.idle = None;
        }
        Busy { of: self.clone(), for_good: false }
    }
}

impl Busy {
    /// The connection is never idle again, as a live socket.
    pub(super) fn for_good(mut self) {
        self.for_good = true;
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        if self.for_good {
            return;
        }
        let mut taken = lock(&self.of.taken);
        let now = taken.next();
        if let Some(open) = taken.open.get_mut(&self.of.number) {
            open.idle = Some(now);
        }
    }
}

fn lock(taken: &Mutex<Taken>) -> MutexGuard<'_, Taken> {
    taken.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(192, 0, 2, 1));
    const OTHER: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(192, 0, 2, 2));

    /// A slot of a connection that is asked for something.
    fn busy(slots: &Slots, address: IpAddr) -> Option<(Slot, Busy)> {
        let slot = slots.take(address)?;
        let busy = slot.uses().begin();
        Some((slot, busy))
    }

    #[test]
    fn neither_one_sender_nor_all_of_them_take_more_than_they_may() {
        let slots = Slots::new(3, 2);
        let first = busy(&slots, ONE).expect("a free slot");
        let _second = busy(&slots, ONE).expect("a free slot");
        assert!(slots.take(ONE).is_none(), "one sender's share is taken");
        let third = busy(&slots, OTHER).expect("a free slot for others");
        assert!(slots.take(OTHER).is_none(), "all slots are taken");
        drop(first);
        assert!(slots.take(ONE).is_some());
        drop(third);
        assert_eq!(lock(&slots.taken).of.len(), 1, "a sender without connections is forgotten");
    }

    /// Whether a connection was told to go.
    async fn is_gone(slot: &Slot) -> bool {
        tokio::time::timeout(std::time::Duration::from_millis(1), slot.gone().notified()).await.is_ok()
    }

    #[tokio::test]
    async fn who_asks_for_nothing_makes_room_the_one_idle_for_longest_first() {
        let slots = Slots::new(4, 3);
        let [first, second, third] = [(); 3].map(|()| slots.take(ONE).expect("a free slot"));
        // The first was asked for something since, so the second has been idle for longest.
        drop(first.uses().begin());
        let socket = third.uses().begin();
        socket.for_good();
        let fourth = slots.take(ONE).expect("the slot of the second");
        assert!(is_gone(&second).await && !is_gone(&first).await && !is_gone(&third).await);
        let _fifth = slots.take(ONE).expect("the slot of the first");
        assert!(is_gone(&first).await && !is_gone(&fourth).await);
        // Those that went are not counted twice.
        drop((first, second));
        assert_eq!(lock(&slots.taken).of[&ONE], 3);
        // Others' idle ones make room only when all slots are taken.
        let _sixth = slots.take(OTHER).expect("a free slot");
        assert!(!is_gone(&fourth).await);
        let _seventh = slots.take(OTHER).expect("the slot of the fourth");
        assert!(is_gone(&fourth).await && !is_gone(&third).await);
    }
}
