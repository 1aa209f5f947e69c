//! Just enough of HTTP/2, byte by byte, for clients that no library would be: they begin a request and leave it at that.

/// What a connection begins with.
const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";
const DATA: u8 = 0;
const HEADERS: u8 = 1;
const SETTINGS: u8 = 4;
const WINDOW_UPDATE: u8 = 8;
const END_STREAM: u8 = 1;
const END_HEADERS: u8 = 4;
const SETTINGS_INITIAL_WINDOW_SIZE: u16 = 4;
/// As much as the protocol can grant.
const LARGEST_WINDOW: u32 = i32::MAX as u32;
/// What a connection is granted from the start.
const FIRST_WINDOW: u32 = 65_535;

/// Preface and settings that let the server send as much as it likes.
pub(super) fn greeting() -> Vec<u8> {
    let mut bytes = PREFACE.to_vec();
    let mut settings = SETTINGS_INITIAL_WINDOW_SIZE.to_be_bytes().to_vec();
    settings.extend(LARGEST_WINDOW.to_be_bytes());
    bytes.extend(frame(SETTINGS, 0, 0, &settings));
    let grant = (LARGEST_WINDOW - FIRST_WINDOW).to_be_bytes();
    bytes.extend(frame(WINDOW_UPDATE, 0, 0, &grant));
    bytes
}

/// Half of a preface.
pub(super) fn half_a_preface() -> &'static [u8] {
    &PREFACE[..PREFACE.len() / 2]
}

/// A greeting and a request's headers that go on in a frame that does not come.
pub(super) fn half_a_header(path: &str) -> Vec<u8> {
    let mut bytes = greeting();
    bytes.extend(frame(HEADERS, 0, 1, &header_block(path)));
    bytes
}

/// A greeting and one whole call with one message.
pub(super) fn call(path: &str, message: &[u8]) -> Vec<u8> {
    let mut bytes = greeting();
    bytes.extend(frame(HEADERS, END_HEADERS, 1, &header_block(path)));
    let mut data = vec![0];
    data.extend((message.len() as u32).to_be_bytes());
    data.extend(message);
    bytes.extend(frame(DATA, END_STREAM, 1, &data));
    bytes
}

fn frame(kind: u8, flags: u8, stream: u32, payload: &[u8]) -> Vec<u8> {
    let length = (payload.len() as u32).to_be_bytes();
    let mut bytes = length[1..].to_vec();
    bytes.extend([kind, flags]);
    bytes.extend(stream.to_be_bytes());
    bytes.extend(payload);
    bytes
}

/// HPACK in its plainest form: every field a literal that is not indexed.
fn header_block(path: &str) -> Vec<u8> {
    let fields = [
        (":method", "POST"),
        (":scheme", "http"),
        (":path", path),
        (":authority", "gateway"),
        ("content-type", "application/grpc"),
        ("te", "trailers"),
    ];
    let mut bytes = Vec::new();
    for (name, value) in fields {
        bytes.push(0);
        for text in [name, value] {
            debug_assert!(
                text.len() < 127,
                "a longer one needs more bytes for its length"
            );
            bytes.push(text.len() as u8);
            bytes.extend(text.as_bytes());
        }
    }
    bytes
}
