//! The dashboard server on its connection: a greeting, then an answer for each line.

use std::io;

use tokio::{
    io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader},
    net::TcpStream,
};

use super::{Shared, lock};

const MAX_LINE_BYTES: u64 = 1024;

pub(super) async fn converse(stream: TcpStream, controller: Shared) -> io::Result<()> {
    let mut stream = BufReader::new(stream);
    stream
        .get_mut()
        .write_all(b"Connected: Universal Robots Dashboard Server\n")
        .await?;
    let mut line = Vec::new();
    loop {
        line.clear();
        (&mut stream)
            .take(MAX_LINE_BYTES)
            .read_until(b'\n', &mut line)
            .await?;
        if line.last() != Some(&b'\n') {
            return Ok(());
        }
        let command = String::from_utf8_lossy(&line).trim().to_owned();
        let last = match command.as_str() {
            "quit" => Some("Disconnected\n"),
            "shutdown" => Some("Shutting down\n"),
            _ => None,
        };
        if let Some(answer) = last {
            return stream.get_mut().write_all(answer.as_bytes()).await;
        }
        let answer = lock(&controller).dashboard(&command) + "\n";
        stream.get_mut().write_all(answer.as_bytes()).await?;
    }
}
