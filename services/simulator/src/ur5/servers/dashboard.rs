//! The dashboard server on its connection: a greeting, then an answer for each line.

use std::{io, sync::Arc};

use super::{Shared, lock, outlet::Outlet};

/// Longest line taken.
const MAX_LINE_BYTES: usize = 1024;

pub(super) async fn converse(outlet: Arc<Outlet>, controller: Shared) -> io::Result<()> {
    outlet.queue(b"Connected: Universal Robots Dashboard Server\n")?;
    outlet.flush().await?;
    let mut buffer = [0; 1024];
    let mut inbox = Vec::new();
    loop {
        let received = outlet.read(&mut buffer).await?;
        if received == 0 {
            return Ok(());
        }
        inbox.extend_from_slice(&buffer[..received]);
        while let Some(end) = inbox.iter().position(|byte| *byte == b'\n') {
            let mut line: Vec<u8> = inbox.drain(..=end).collect();
            if !outlet.takes(&mut line) {
                continue;
            }
            let command = String::from_utf8_lossy(&line).trim().to_owned();
            let last = match command.as_str() {
                "quit" => Some("Disconnected\n"),
                "shutdown" => Some("Shutting down\n"),
                _ => None,
            };
            if let Some(answer) = last {
                outlet.queue(answer.as_bytes())?;
                return outlet.flush().await;
            }
            let answer = lock(&controller).dashboard(&command) + "\n";
            outlet.queue(answer.as_bytes())?;
        }
        if inbox.len() > MAX_LINE_BYTES {
            return Err(io::Error::other("line is too long"));
        }
        outlet.flush().await?;
    }
}
