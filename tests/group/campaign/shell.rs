//! A shell with a real-time priority, as the program of a stop button may have it: what it starts need not wait until
//! an ordinary program leaves it a core.

use std::{
    process::{Child, Command},
    sync::mpsc::{Receiver, Sender, channel},
    thread,
};

use pipeline::stage::schedule;

/// The lowest one of SCHED_FIFO.
const PRIORITY: u8 = 1;

pub struct FirstShell {
    typed: Sender<Command>,
    started: Receiver<Child>,
}

impl FirstShell {
    /// None where this computer does not give the priority.
    pub fn start() -> Option<Self> {
        let ((typed, commands), (children, started)) = (channel::<Command>(), channel());
        let (tried, is_given) = channel();
        thread::spawn(move || {
            let given = schedule(PRIORITY);
            tried.send(given.is_ok()).unwrap();
            if given.is_ok() {
                commands.into_iter().for_each(|mut command| children.send(command.spawn().unwrap()).unwrap());
            }
        });
        is_given.recv().unwrap().then_some(Self { typed, started })
    }

    pub fn spawn(&self, command: Command) -> Child {
        self.typed.send(command).unwrap();
        self.started.recv().unwrap()
    }
}
