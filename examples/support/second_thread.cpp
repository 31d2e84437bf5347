#include "support/second_thread.hpp"

namespace program {

SecondThread::SecondThread() : thread_([this] { help(); }) {}

SecondThread::~SecondThread() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

void SecondThread::for_each_block(int count, const clothctl::BlockTask& task) {
  next_ = 0;
  {
    const std::lock_guard lock(mutex_);
    task_ = &task;
    count_ = count;
  }
  wake_.notify_one();
  work(task, count);
  std::unique_lock lock(mutex_);
  task_ = nullptr;
  done_.wait(lock, [this] { return !busy_; });
}

void SecondThread::help() {
  std::unique_lock lock(mutex_);
  while (true) {
    wake_.wait(lock, [this] { return ends_ || (task_ != nullptr && next_ < count_); });
    if (ends_) return;
    const clothctl::BlockTask task = *task_;
    const int count = count_;
    busy_ = true;
    lock.unlock();
    work(task, count);
    lock.lock();
    busy_ = false;
    done_.notify_one();
  }
}

void SecondThread::work(const clothctl::BlockTask& task, int count) {
  for (int i = next_++; i < count; i = next_++) task(i);
}

SecondThread& second_thread() {
  static SecondThread thread;
  return thread;
}

}  // namespace program
