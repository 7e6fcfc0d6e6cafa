//! Lists with a limit, for files that may claim any number of values.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Deserialize, Deserializer, Error, SeqAccess, Visitor};

/// Reads a list of at most `MOST` values. A longer one is refused at its first value too many, before there is room for
/// it.
pub(crate) fn bounded<'de, D, T, const MOST: usize>(deserializer: D) -> Result<Vec<T>, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de>,
{
    deserializer.deserialize_seq(Bounded::<T, MOST>(PhantomData))
}

struct Bounded<T, const MOST: usize>(PhantomData<T>);

impl<'de, T: Deserialize<'de>, const MOST: usize> Visitor<'de> for Bounded<T, MOST> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a list of at most {MOST}")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Vec<T>, A::Error> {
        let mut values = Vec::new();
        while let Some(value) = list.next_element()? {
            if values.len() == MOST {
                return Err(A::Error::custom(format_args!("more than {MOST} values, expected at most {MOST}")));
            }
            values.push(value);
        }
        Ok(values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, serde::Deserialize)]
    struct Some {
        #[serde(deserialize_with = "bounded::<_, _, 3>")]
        list: Vec<u8>,
    }

    #[test]
    fn a_list_that_is_too_long_is_refused_by_its_key() {
        let read = |text: &str| {
            let mut json = serde_json::Deserializer::from_str(text);
            serde_path_to_error::deserialize::<_, Some>(&mut json).map(|some| some.list).map_err(|e| e.to_string())
        };
        assert_eq!(read(r#"{"list": [1, 2, 3]}"#), Ok(vec![1, 2, 3]));
        let error = read(r#"{"list": [1, 2, 3, 4, 5]}"#).expect_err("too long");
        assert!(error.starts_with("list: more than 3 values, expected at most 3"), "{error}");
        let error = read(r#"{"list": 7}"#).expect_err("no list");
        assert!(error.starts_with("list: invalid type: integer `7`, expected a list of at most 3"), "{error}");
    }
}
