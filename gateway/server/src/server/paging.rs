//! Pages of a list: `page_size` and `page_token` of a request, `next_page_token` of its answer.

use crate::error::Violation;
use crate::journal::Page;

const SIZE_DEFAULT: u32 = 100;
const SIZE_MOST: u32 = 1000;

/// Entries of a page.
pub(super) fn size(asked: u32) -> Result<u32, Violation> {
    match asked {
        0 => Ok(SIZE_DEFAULT),
        1..=SIZE_MOST => Ok(asked),
        _ => Err(Violation::new(
            "page_size",
            format!("is {asked}; must be within 1 .. {SIZE_MOST}, or 0 for {SIZE_DEFAULT}"),
        )),
    }
}

/// What the journal is asked for: one more than the page has, so that its end is known.
pub(super) fn page(size: u32, token: String) -> Page {
    Page {
        after: Some(token).filter(|token| !token.is_empty()),
        limit: size + 1,
    }
}

/// Cuts what was read down to the page; the token is the last one's id, and empty when nothing follows.
pub(super) fn cut<T>(read: &mut Vec<T>, size: u32, id: impl Fn(&T) -> &str) -> String {
    let size = size as usize;
    if read.len() <= size {
        return String::new();
    }
    read.truncate(size);
    read.last()
        .map_or_else(String::new, |last| id(last).to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut_of(read: &[&str]) -> (Vec<String>, String) {
        let mut read: Vec<String> = read.iter().map(|id| (*id).to_owned()).collect();
        let token = cut(&mut read, 2, |id| id);
        (read, token)
    }

    #[test]
    fn the_last_page_has_no_token() {
        assert_eq!(cut_of(&["a", "b"]).1, "");
        assert_eq!(cut_of(&[]).1, "");
    }

    #[test]
    fn the_token_is_the_last_of_the_page_and_what_follows_is_left_to_the_next() {
        let (page, token) = cut_of(&["a", "b", "c"]);
        assert_eq!((page, token.as_str()), (vec!["a".into(), "b".into()], "b"));
    }
}
